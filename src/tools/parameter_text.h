#pragma once

#include <locale>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "common/join.h"
#include "point_line_odometry/input_error.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// Sets the parameter of one name from text; `found` tells whether there is such a one.
struct ParameterSetter {
  std::string name;
  std::string text;
  bool found = false;

  template <typename T, typename... Rest>
  void operator()(const char* candidate, T& value, const Rest&...) {
    if (name != candidate) return;
    found = true;
    parse(value);
  }

 private:
  void parse(bool& value) const {
    if (text != "true" && text != "false") refuse("true or false");
    value = text == "true";
  }

  void parse(std::string& value) const { value = text; }

  template <typename T>
  void parse(T& value) const {
    std::istringstream in(text);
    in.imbue(std::locale::classic());
    if (!(in >> value) || in.peek() != std::istringstream::traits_type::eof()) {
      refuse(std::is_integral<T>::value ? "a whole number" : "a number");
    }
  }

  [[noreturn]] void refuse(const char* expected) const {
    throw InputError("parameter " + name + " is set to '" + text + "', but must be " + expected);
  }
};

/// Applies settings "name=value". Throws InputError for unknown names and values that do not fit.
inline Parameters applySettings(Parameters parameters, const std::vector<std::string>& settings) {
  for (const std::string& setting : settings) {
    const std::size_t equals = setting.find('=');
    if (equals == std::string::npos) {
      throw InputError("setting '" + setting + "' has no '=': write --set name=value");
    }
    ParameterSetter setter{setting.substr(0, equals), setting.substr(equals + 1), false};
    visitParameters(parameters, setter);
    if (!setter.found) {
      throw InputError("unknown parameter '" + setter.name +
                       "': --print-parameters shows those there are");
    }
  }
  const std::vector<std::string> errors = checkParameters(parameters);
  if (!errors.empty()) throw InputError("parameters do not fit: " + join(errors, "; "));
  return parameters;
}

/// A parameter in words.
struct ParameterRow {
  std::string name;
  std::string value;
  std::string range;
  std::string unit;
  std::string text;
};

/// Visitor of a parameter table that puts each parameter into words.
struct ParameterRows {
  std::vector<ParameterRow> rows;

  void operator()(const char* name, bool value, const char* text) {
    rows.push_back({name, value ? "true" : "false", "true, false", "", text});
  }

  void operator()(const char* name, const std::string& value, const char* text) {
    rows.push_back({name, value, "", "", text});
  }

  template <typename T>
  void operator()(const char* name, T value, T minimum, T maximum, const char* unit,
                  const char* text) {
    rows.push_back({name, format(value), format(minimum) + " ... " + format(maximum), unit, text});
  }

  void operator()(const char* name, const std::string& value,
                  const std::vector<std::string>& choices, const char* text) {
    rows.push_back({name, value, join(choices, ", "), "", text});
  }

 private:
  template <typename T>
  static std::string format(T value) {
    std::ostringstream text;
    text.imbue(std::locale::classic());
    text << value;
    return text.str();
  }
};

/// A table in Markdown.
inline std::string formatMarkdownTable(const std::vector<ParameterRow>& rows) {
  std::string table = "| name | default | range | unit | meaning |\n|---|---|---|---|---|\n";
  for (const ParameterRow& row : rows) {
    table += "| `" + row.name + "` | " + row.value + " | " + row.range + " | " + row.unit + " | " +
             row.text + " |\n";
  }
  return table;
}

/// The core's parameters with their defaults as a table in Markdown.
inline std::string formatParameterTable() {
  ParameterRows table;
  const Parameters defaults;
  visitParameters(defaults, table);
  return formatMarkdownTable(table.rows);
}

}  // namespace point_line_odometry
