#pragma once

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "point_line_odometry/dataset.h"

namespace point_line_odometry {

/// A folder whose files appear all at once, when they are whole: until commit() they have temporary
/// names, and without a commit() the destructor takes them (and the folder, if it was made here)
/// away.
class OutputFolder {
 public:
  /// Makes the folder. Throws InputError if that cannot be done.
  explicit OutputFolder(const std::string& folder) : folder_(folder) {
    std::error_code error;
    made_ = std::filesystem::create_directories(folder_, error);
    if (error) {
      throw InputError("output folder '" + folder + "' cannot be made (" + error.message() +
                       "): give a folder that you may write to");
    }
  }

  ~OutputFolder() {
    std::error_code ignored;
    for (const std::string& name : names_) std::filesystem::remove_all(temporary(name), ignored);
    if (made_ && !committed_) std::filesystem::remove(folder_, ignored);
  }
  OutputFolder(const OutputFolder&) = delete;
  OutputFolder& operator=(const OutputFolder&) = delete;

  /// Checks that a file can be written here, so that a long run does not end in vain.
  void reserve(const std::string& name) {
    names_.push_back(name);
    if (!std::ofstream(temporary(name))) refuse(name);
  }

  /// Writes the whole file under its temporary name.
  void write(const std::string& name, const std::string& content) const {
    std::ofstream out(temporary(name), std::ios::binary);
    out << content;
    out.close();
    if (!out) refuse(name);
  }

  /// Makes a sub-folder under a temporary name and returns that name.
  std::filesystem::path makeFolder(const std::string& name) {
    names_.push_back(name);
    std::error_code error;
    std::filesystem::remove_all(temporary(name), error);
    std::filesystem::create_directory(temporary(name), error);
    if (error) refuse(name);
    return temporary(name);
  }

  /// Gives every file its name; older files of that name are replaced.
  void commit() {
    for (const std::string& name : names_) {
      std::error_code error;
      if (std::filesystem::is_directory(temporary(name))) {
        std::filesystem::remove_all(folder_ / name, error);
      }
      std::filesystem::rename(temporary(name), folder_ / name, error);
      if (error) refuse(name);
    }
    committed_ = true;
  }

 private:
  std::filesystem::path temporary(const std::string& name) const {
    return folder_ / (name + ".part");
  }

  [[noreturn]] void refuse(const std::string& name) const {
    throw InputError("'" + (folder_ / name).string() +
                     "' cannot be written: give a folder that you may write to, with room on disk");
  }

  std::filesystem::path folder_;
  bool made_ = false;
  bool committed_ = false;
  std::vector<std::string> names_;
};

}  // namespace point_line_odometry
