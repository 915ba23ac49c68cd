#pragma once

/// \file
/// Rows of text files of data sets, and errors that name the file.

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <fstream>
#include <locale>
#include <sstream>
#include <string>
#include <vector>

#include "common/input_error.h"

namespace point_line_odometry {

/// Throws an InputError of these parts.
template <typename... Parts>
[[noreturn]] void fail(const Parts&... parts) {
  std::ostringstream text;
  (text << ... << parts);
  throw InputError(text.str());
}

inline std::string inQuotes(const std::filesystem::path& path) { return "'" + path.string() + "'"; }

/// Lines without line ends (LF or CRLF); empty lines, comments (#) and a mark of UTF-8 are skipped.
inline std::vector<std::string> readLines(const std::filesystem::path& file) {
  std::ifstream in(file);
  if (!in)
    fail("file ", inQuotes(file), " is missing or unreadable: unpack the data set completely");
  std::vector<std::string> lines;
  constexpr const char* kByteOrderMark = "\xEF\xBB\xBF";
  bool is_first = true;
  for (std::string line; std::getline(in, line); is_first = false) {
    if (is_first && line.rfind(kByteOrderMark, 0) == 0) line.erase(0, 3);
    while (!line.empty() && std::isspace(static_cast<unsigned char>(line.back()))) line.pop_back();
    if (!line.empty() && line.front() != '#') lines.push_back(line);
  }
  return lines;
}

/// The same of a table of numbers, without names of its columns that are no comment.
inline std::vector<std::string> readTable(const std::filesystem::path& file) {
  std::vector<std::string> lines = readLines(file);
  const auto is_name = [](char c) { return std::isalpha(static_cast<unsigned char>(c)) != 0; };
  if (lines.size() > 1 && is_name(lines.front().front())) lines.erase(lines.begin());
  return lines;
}

/// The numbers of a row, separated by blanks or commas. Throws for anything else.
inline std::vector<double> parseNumbers(std::string row, const std::filesystem::path& file) {
  std::replace(row.begin(), row.end(), ',', ' ');
  std::istringstream in(row);
  in.imbue(std::locale::classic());
  std::vector<double> numbers;
  for (double number = 0.0; in >> number;) numbers.push_back(number);
  if (!in.eof()) fail("file ", inQuotes(file), " has a row that is not numbers: '", row, "'");
  return numbers;
}

/// True for a regular file: not a folder, a pipe or a device.
inline bool isFile(const std::filesystem::path& path) {
  std::error_code ignored;
  return std::filesystem::is_regular_file(path, ignored);
}

}  // namespace point_line_odometry
