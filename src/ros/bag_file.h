#pragma once

#include <fcntl.h>
#include <ros/message_traits.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <unistd.h>

#include <filesystem>
#include <string>
#include <system_error>

#include "common/input_error.h"

namespace point_line_odometry {

/// A bag that is written to NAME.part and renamed by commit(); without commit() the destructor
/// removes it. An older bag of that name is replaced if the same writer has made it. Throws
/// InputError if it cannot be created or renamed, rosbag::BagException if it cannot be written to.
class BagFile {
 public:
  /// \param writer node name that latched messages have as their publisher (callerid).
  BagFile(const std::string& file, rosbag::CompressionType compression, const std::string& writer)
      : file_(file), part_(file + ".part"), writer_(writer) {
    requireOwn();
    try {
      bag_.open(part_, rosbag::bagmode::Write);
    } catch (const rosbag::BagException&) {
      closeAnyhow();
      throw InputError("bag '" + file + "' cannot be written: give a file in a folder that is " +
                       "there and that you may write to");
    }
    bag_.setCompression(compression);
  }

  ~BagFile() {
    if (committed_) return;
    closeAnyhow();
    std::error_code ignored;
    std::filesystem::remove(part_, ignored);
  }
  BagFile(const BagFile&) = delete;
  BagFile& operator=(const BagFile&) = delete;

  template <typename Message>
  void write(const std::string& topic, const ros::Time& stamp, const Message& message) {
    bag_.write(topic, stamp, message);
  }

  /// Writes a message that a player publishes latched.
  template <typename Message>
  void writeLatched(const std::string& topic, const ros::Time& stamp, const Message& message) {
    const auto header = boost::make_shared<ros::M_string>();
    (*header)["topic"] = topic;
    (*header)["type"] = ros::message_traits::datatype(message);
    (*header)["md5sum"] = ros::message_traits::md5sum(message);
    (*header)["message_definition"] = ros::message_traits::definition(message);
    (*header)["callerid"] = writer_;
    (*header)["latching"] = "1";
    bag_.write(topic, stamp, message, header);
  }

  void commit() {
    bag_.close();
    std::error_code error;
    std::filesystem::rename(part_, file_, error);
    if (error) {
      throw InputError("bag '" + file_ + "' cannot be written (" + error.message() +
                       "): give another name");
    }
    committed_ = true;
  }

 private:
  void requireOwn() const {
    std::error_code ignored;
    if (!std::filesystem::exists(file_, ignored) || isOwn()) return;
    throw InputError("'" + file_ + "' exists already and is no bag that " + writer_.substr(1) +
                     " has written: give another name, or remove it");
  }

  bool isOwn() const {
    try {
      const rosbag::Bag older(file_);
      rosbag::View all(older);
      for (const rosbag::ConnectionInfo* connection : all.getConnections()) {
        const auto writer = connection->header->find("callerid");
        if (writer != connection->header->end() && writer->second == writer_) return true;
      }
    } catch (const ros::Exception&) {
      // no bag
    }
    return false;
  }

  /// A bag on a full disk cannot be closed either: its destructor would throw and end the process.
  /// So its file descriptor is redirected to /dev/null first.
  void closeAnyhow() {
    namespace fs = std::filesystem;
    std::error_code error;
    const fs::path part = fs::canonical(part_, error);
    const int null_device = ::open("/dev/null", O_RDWR | O_CLOEXEC);
    for (const fs::directory_entry& entry : fs::directory_iterator("/proc/self/fd", error)) {
      if (null_device >= 0 && !part.empty() && fs::read_symlink(entry.path(), error) == part)
        ::dup2(null_device, std::stoi(entry.path().filename().string()));
    }
    if (null_device >= 0) ::close(null_device);
    try {
      bag_.close();
    } catch (const rosbag::BagException&) {
      // The file is removed anyway.
    }
  }

  std::string file_;
  std::string part_;
  std::string writer_;
  rosbag::Bag bag_;
  bool committed_ = false;
};

}  // namespace point_line_odometry
