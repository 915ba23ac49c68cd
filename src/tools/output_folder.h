#pragma once

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "point_line_odometry/input_error.h"

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

  /// An older file of that name, which would not belong to the new ones, goes away at commit().
  void discard(const std::string& name) { discarded_.push_back(name); }

  /// Gives every file its name; older files of that name are replaced.
  void commit() {
    for (const std::string& name : discarded_) {
      std::error_code ignored;
      std::filesystem::remove(folder_ / name, ignored);
    }
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
  std::vector<std::string> discarded_;
};

/// A folder that appears as a whole: until commit() it has a temporary name, and without a commit()
/// the destructor takes it away. A file in it marks it as written by this class, so that it may be
/// replaced; a folder of anything else is never touched.
class NewFolder {
 public:
  /// \param marker name of the file that marks it. Throws InputError if `folder` is there, not
  /// empty and without that mark, or if it cannot be made.
  NewFolder(const std::string& folder, const std::string& marker, const std::string& mark)
      : folder_(withoutSlash(folder)), part_(folder_.string() + ".part"), marker_(marker) {
    std::error_code error;
    requireOwn(folder_);
    requireOwn(part_);
    std::filesystem::remove_all(part_, error);
    std::filesystem::create_directories(part_, error);
    std::ofstream out(part_ / marker_, std::ios::binary);
    out << mark;
    out.close();
    if (out) return;
    std::filesystem::remove_all(part_, error);
    refuse();
  }

  ~NewFolder() {
    std::error_code ignored;
    if (!committed_) std::filesystem::remove_all(part_, ignored);
  }
  NewFolder(const NewFolder&) = delete;
  NewFolder& operator=(const NewFolder&) = delete;

  /// Where to write.
  std::string path() const { return part_.string(); }

  /// Gives the folder its name.
  void commit() {
    std::error_code error;
    const std::filesystem::path older = part_ / ".replaced";
    if (std::filesystem::exists(folder_)) std::filesystem::rename(folder_, older, error);
    if (!error) std::filesystem::rename(part_, folder_, error);
    if (error) refuse();
    committed_ = true;
    std::filesystem::remove_all(folder_ / ".replaced", error);
  }

 private:
  static std::filesystem::path withoutSlash(const std::string& folder) {
    const std::filesystem::path path = std::filesystem::absolute(folder).lexically_normal();
    return path.has_filename() ? path : path.parent_path();
  }

  void requireOwn(const std::filesystem::path& folder) const {
    namespace fs = std::filesystem;
    std::error_code error;
    if (!fs::exists(folder, error) || fs::exists(folder / marker_, error)) return;
    if (fs::is_directory(folder, error) && fs::is_empty(folder, error)) return;
    throw InputError("'" + folder.string() + "' is there already and was not written by this " +
                     "program: give another name, or take it away");
  }

  [[noreturn]] void refuse() const {
    throw InputError("folder '" + folder_.string() +
                     "' cannot be written: give a folder that you may write to, with room on disk");
  }

  std::filesystem::path folder_;
  std::filesystem::path part_;
  std::string marker_;
  bool committed_ = false;
};

}  // namespace point_line_odometry
