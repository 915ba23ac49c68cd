#include "tools/output_folder.h"

#include <algorithm>
#include <fstream>
#include <utility>

#include "common/input_error.h"

namespace point_line_odometry {
namespace {

/// Removes the files of a folder whose names are numbers, as 000012.png.
void removeNumbered(const std::filesystem::path& folder) {
  std::error_code ignored;
  std::vector<std::filesystem::path> numbered;
  for (const auto& entry : std::filesystem::directory_iterator(folder, ignored)) {
    const std::string stem = entry.path().stem().string();
    if (stem.find_first_not_of("0123456789") == std::string::npos) numbered.push_back(entry.path());
  }
  for (const std::filesystem::path& file : numbered) std::filesystem::remove(file, ignored);
}

}  // namespace

OutputFolder::OutputFolder(const std::string& folder, std::optional<Names> own)
    : folder_(folder), own_(std::move(own)) {
  std::error_code error;
  made_ = std::filesystem::create_directories(folder_, error);
  if (error) {
    throw InputError("output folder '" + folder + "' cannot be made (" + error.message() +
                     "): give a folder that you may write to");
  }
}

OutputFolder::~OutputFolder() {
  std::error_code ignored;
  for (const std::string& name : names_) std::filesystem::remove_all(temporary(name), ignored);
  if (made_ && !committed_) std::filesystem::remove(folder_, ignored);
}

void OutputFolder::requireOwn(const std::string& name) const {
  std::error_code ignored;
  if (!own_ || own_->count(name) > 0 || !std::filesystem::exists(folder_ / name, ignored)) return;
  throw InputError("'" + (folder_ / name).string() +
                   "' exists already and was not written by this program: give another folder, or "
                   "remove it");
}

void OutputFolder::reserve(const std::string& name) {
  requireOwn(name);
  names_.push_back(name);
  if (!std::ofstream(temporary(name))) refuse(name);
}

void OutputFolder::write(const std::string& name, const std::string& content) const {
  std::ofstream out(temporary(name), std::ios::binary);
  out << content;
  out.close();
  if (!out) refuse(name);
}

std::filesystem::path OutputFolder::makeFolder(const std::string& name) {
  requireOwn(name);
  names_.push_back(name);
  std::error_code error;
  std::filesystem::remove_all(temporary(name), error);
  std::filesystem::create_directory(temporary(name), error);
  if (error) refuse(name);
  return temporary(name);
}

void OutputFolder::commit() {
  for (const std::string& name : names_) {
    std::error_code error;
    if (std::filesystem::is_directory(temporary(name))) {
      replaceFolder(temporary(name), folder_ / name);
    } else {
      std::filesystem::rename(temporary(name), folder_ / name, error);
    }
    if (error || std::filesystem::exists(temporary(name))) refuse(name);
  }
  committed_ = true;
  for (const std::string& name : own_.value_or(Names())) {
    std::error_code ignored;
    if (std::find(names_.begin(), names_.end(), name) != names_.end()) continue;
    if (std::filesystem::is_directory(folder_ / name)) removeNumbered(folder_ / name);
    std::filesystem::remove(folder_ / name, ignored);  // not a folder with other files
  }
}

void OutputFolder::replaceFolder(const std::filesystem::path& from,
                                 const std::filesystem::path& to) {
  std::error_code ignored;
  removeNumbered(to);
  std::filesystem::create_directory(to, ignored);
  for (const auto& entry : std::filesystem::directory_iterator(from, ignored))
    std::filesystem::rename(entry.path(), to / entry.path().filename(), ignored);
  std::filesystem::remove(from, ignored);
}

void OutputFolder::release(const std::string& name) {
  std::error_code ignored;
  std::filesystem::remove(temporary(name), ignored);
  names_.erase(std::remove(names_.begin(), names_.end(), name), names_.end());
}

std::filesystem::path OutputFolder::temporary(const std::string& name) const {
  return folder_ / (name + ".part");
}

void OutputFolder::refuse(const std::string& name) const {
  throw InputError("'" + (folder_ / name).string() +
                   "' cannot be written: give a folder that you may write to, with room on disk");
}

NewFolder::NewFolder(const std::string& folder, const std::string& marker, const std::string& mark)
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

NewFolder::~NewFolder() {
  std::error_code ignored;
  if (!committed_) std::filesystem::remove_all(part_, ignored);
}

void NewFolder::commit() {
  std::error_code error;
  const std::filesystem::path older = part_ / ".replaced";
  if (std::filesystem::exists(folder_)) std::filesystem::rename(folder_, older, error);
  if (!error) std::filesystem::rename(part_, folder_, error);
  if (error) {
    std::error_code ignored;
    if (std::filesystem::exists(older)) std::filesystem::rename(older, folder_, ignored);
    refuse();
  }
  committed_ = true;
  std::filesystem::remove_all(folder_ / ".replaced", error);
}

std::filesystem::path NewFolder::withoutSlash(const std::string& folder) {
  const std::filesystem::path path = std::filesystem::absolute(folder).lexically_normal();
  return path.has_filename() ? path : path.parent_path();
}

void NewFolder::requireOwn(const std::filesystem::path& folder) const {
  namespace fs = std::filesystem;
  std::error_code error;
  if (!fs::exists(folder, error) || fs::exists(folder / marker_, error)) return;
  if (fs::is_directory(folder, error) && fs::is_empty(folder, error)) return;
  throw InputError("'" + folder.string() + "' exists already and was not written by this " +
                   "program: give another name, or remove it");
}

void NewFolder::refuse() const {
  throw InputError("folder '" + folder_.string() +
                   "' cannot be written: give a folder that you may write to, with room on disk");
}

}  // namespace point_line_odometry
