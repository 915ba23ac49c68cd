#pragma once

#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace point_line_odometry {

/// A folder whose files appear together: they have temporary names until commit(); without commit()
/// the destructor removes them, and the folder if it was created here.
class OutputFolder {
 public:
  /// What is in a folder, by name.
  using Names = std::set<std::string>;

  /// Creates the folder. \param own what the same program has written there before: nothing else is
  /// replaced, and what is not written again is removed; without it, what is in the way is
  /// replaced. Throws InputError if the folder cannot be made.
  explicit OutputFolder(const std::string& folder, std::optional<Names> own = std::nullopt);

  ~OutputFolder();
  OutputFolder(const OutputFolder&) = delete;
  OutputFolder& operator=(const OutputFolder&) = delete;

  /// Checks that a file can be written here, so that a long run does not fail at its end. Throws
  /// InputError if not, or if there is one that must not be replaced.
  void reserve(const std::string& name);

  /// Throws InputError if there is something of that name that must not be replaced.
  void requireOwn(const std::string& name) const;

  /// A reserved file will not be written.
  void release(const std::string& name);

  /// Writes the whole file under its temporary name.
  void write(const std::string& name, const std::string& content) const;

  /// Creates a sub-folder under a temporary name and returns that name. Throws likewise.
  std::filesystem::path makeFolder(const std::string& name);

  /// What will be there.
  const std::vector<std::string>& names() const { return names_; }

  /// Gives every file its name; older files of that name are replaced, and those of a folder whose
  /// names are numbers.
  void commit();

 private:
  std::filesystem::path temporary(const std::string& name) const;

  static void replaceFolder(const std::filesystem::path& from, const std::filesystem::path& to);

  [[noreturn]] void refuse(const std::string& name) const;

  std::filesystem::path folder_;
  std::optional<Names> own_;
  bool made_ = false;
  bool committed_ = false;
  std::vector<std::string> names_;
};

/// A folder that appears as a whole: it has a temporary name until commit(); without commit() the
/// destructor removes it. A marker file shows that it was written by this class and may be
/// replaced; a folder without it is never touched.
class NewFolder {
 public:
  /// \param marker name of the marker file. \param mark its first line. Throws InputError if
  /// `folder` exists, is not empty and has no such marker, or if it cannot be created.
  NewFolder(const std::string& folder, const std::string& marker, const std::string& mark);

  ~NewFolder();
  NewFolder(const NewFolder&) = delete;
  NewFolder& operator=(const NewFolder&) = delete;

  /// Where to write.
  std::string path() const { return part_.string(); }

  /// Gives the folder its name.
  void commit();

 private:
  static std::filesystem::path withoutSlash(const std::string& folder);

  void requireOwn(const std::filesystem::path& folder) const;

  [[noreturn]] void refuse() const;

  std::filesystem::path folder_;
  std::filesystem::path part_;
  std::string marker_;
  bool committed_ = false;
};

}  // namespace point_line_odometry
