#include "ros/recording_writer.h"

#include <rosbag/exceptions.h>
#include <sys/time.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <boost/crc.hpp>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <regex>
#include <stdexcept>

#include "common/classic_stream.h"
#include "common/recording_format.h"
#include "point_line_odometry/version.h"
#include "ros/bag_file.h"
#include "ros/camera_messages.h"
#include "ros/conversions.h"

namespace point_line_odometry {
namespace {

namespace fs = std::filesystem;

/// Removes files again unless keep() is called.
class Unfinished {
 public:
  ~Unfinished() {
    std::error_code ignored;
    for (const fs::path& file : files_) fs::remove(file, ignored);
  }
  void add(const fs::path& file) { files_.push_back(file); }
  void keep() { files_.clear(); }

 private:
  std::vector<fs::path> files_;
};

fs::path rosHome() {
  if (const char* ros_home = std::getenv("ROS_HOME")) return ros_home;
  const char* home = std::getenv("HOME");
  return fs::path(home != nullptr ? home : "/tmp") / ".ros";
}

/// Local time, as rosbag names its files, and the milliseconds: "2024-05-31-14-07-59-042".
std::string timeName() {
  timeval now{};
  gettimeofday(&now, nullptr);
  std::tm local{};
  localtime_r(&now.tv_sec, &local);
  std::ostringstream name = classicStream();
  name << std::put_time(&local, "%Y-%m-%d-%H-%M-%S-") << std::setw(3) << std::setfill('0')
       << now.tv_usec / 1000;
  return name.str();
}

void writeFile(const fs::path& file, const std::string& content, Unfinished* unfinished) {
  unfinished->add(file);
  std::ofstream out(file, std::ios::binary);
  out << content;
  out.close();
  if (!out) throw std::runtime_error("'" + file.string() + "' cannot be written");
}

/// With all digits, so that the replay reads the same bits.
template <typename Matrix>
void writeMatrix(std::ostream& out, const Matrix& matrix) {
  const char* separator = "[";
  for (int row = 0; row < matrix.rows(); ++row) {
    for (int column = 0; column < matrix.cols(); ++column) {
      out << separator << matrix(row, column);
      separator = ", ";
    }
  }
  out << "]";
}

void writePrior(std::ostream& out, const MotionPrior& prior) {
  out << ", prior: {from_ns: " << prior.from_ns << ", to_ns: " << prior.to_ns << ", T_prev_curr: ";
  writeMatrix(out, prior.T_prev_curr.matrix().topRows<3>());
  out << ", information: ";
  writeMatrix(out, prior.information);
  out << "}";
}

void writeTilt(std::ostream& out, const TiltCorrection& tilt) {
  out << ", tilt: {up: ";
  writeMatrix(out, tilt.up);
  out << ", rotation: ";
  writeMatrix(out, tilt.rotation);
  out << ", covariance: ";
  writeMatrix(out, tilt.covariance);
  out << "}";
}

void writeTexts(std::ostream& out, const ParameterTexts& parameters, const char* indent,
                const char* end) {
  for (const auto& [name, value] : parameters) out << indent << name << ": " << value << end;
}

geometry_msgs::TransformStamped mounting(const Recording& recording) {
  const RecordedFrame& first = recording.frames.front();
  geometry_msgs::TransformStamped transform;
  transform.header = makeHeader(first.odometry.child_frame_id, first.odometry.header.stamp);
  transform.child_frame_id = withoutLeadingSlash(first.messages.left->header.frame_id);
  transform.transform = toTransform(first.T_base_header);
  return transform;
}

/// The topics of the bag.
struct Topics {
  std::string left;
  std::string right;
  std::string name_space;

  explicit Topics(const RecordingTarget& target) : name_space(target.name_space) {
    const std::string image = imageTopicName(target.parameters.rectify);
    left = name_space + "/left/" + image;
    right = name_space + "/right/" + image;
  }
};

void writeBag(const Recording& recording, const RecordingTarget& target, const fs::path& file,
              Unfinished* unfinished) {
  const Topics topics(target);
  BagFile bag(file.string(), rosbag::compression::Uncompressed, target.node);
  const auto& first = recording.frames.front().messages.left->header;
  if (first.frame_id != target.parameters.base_frame_id) {
    tf2_msgs::TFMessage transforms;
    transforms.transforms.push_back(mounting(recording));
    bag.writeLatched("/tf_static", first.stamp, transforms);
  }
  for (const RecordedFrame& frame : recording.frames) {
    const StereoMessages& m = frame.messages;
    bag.write(topics.name_space + "/left/camera_info", m.left->header.stamp, *m.left_info);
    bag.write(topics.name_space + "/right/camera_info", m.right->header.stamp, *m.right_info);
    bag.write(topics.left, m.left->header.stamp, *m.left);
    bag.write(topics.right, m.right->header.stamp, *m.right);
    const auto writeMask = [&](const char* side, const cv::Mat& mask, const auto& header) {
      if (mask.empty()) return;
      bag.write(topics.name_space + "/" + side + "/mask_image", m.left->header.stamp,
                *toImageMessage(mask, header));
    };
    writeMask("left", frame.left_mask, m.left->header);
    writeMask("right", frame.right_mask, m.right->header);
    bag.write(topics.name_space + "/odom", m.left->header.stamp, frame.odometry);
  }
  bag.commit();
  unfinished->add(file);
}

bool hasMasks(const Recording& recording) {
  return std::any_of(recording.frames.begin(), recording.frames.end(), [](const auto& frame) {
    return !frame.left_mask.empty() || !frame.right_mask.empty();
  });
}

std::string formatYaml(const Recording& recording, const RecordingTarget& target,
                       const RecordingFiles& files, const std::string& reason) {
  const std::string& state = recording.start->state;
  boost::crc_32_type crc;
  crc.process_bytes(state.data(), state.size());
  const Topics topics(target);
  const NodeParameters& node = target.parameters;
  std::ostringstream out = classicStream();
  out.precision(std::numeric_limits<double>::max_digits10);
  out << "# Of point_line_odometry's flight recorder; replay: rosrun point_line_odometry "
         "offline_odometry "
      << files.yaml.filename().string() << " -o DIR\n"
      << "format: " << kRecordingFormat << "\nversion: " << version() << "\nnode: " << target.node
      << "\nreason: " << reason << "\nbag: " << files.bag.filename().string()
      << "\nleft_topic: " << topics.left << "\nright_topic: " << topics.right
      << "\nmax_interval_s: "
      << (node.approximate_sync ? node.approximate_sync_max_interval_s : 0.0)
      << "\nmasks: " << (hasMasks(recording) ? "true" : "false")
      << "\nstate: {file: " << files.state.filename().string() << ", size: " << state.size()
      << ", crc32: " << crc.checksum() << "}\n"
      << "# Poses are 3 x 4 matrices row by row: of " << node.base_frame_id << " before the first\n"
      << "# frame, of the rectified left camera at each frame, both in " << node.odom_frame_id
      << ".\nT_odom_base: ";
  writeMatrix(out, recording.start->T_odom_base.matrix().topRows<3>());
  out << "\nparameters:\n";
  writeTexts(out, parameterTexts(*recording.frames.front().parameters), "  ", "\n");
  out << "frames:\n";
  const Parameters* before = recording.frames.front().parameters.get();
  for (const RecordedFrame& frame : recording.frames) {
    out << "  - {stamp_ns: " << toNanoseconds(frame.odometry.header.stamp)
        << ", state: " << toString(frame.state) << ", reason: " << toString(frame.reason)
        << ", T_odom_camera: ";
    writeMatrix(out, frame.T_odom_camera.matrix().topRows<3>());
    if (frame.prior) writePrior(out, *frame.prior);
    if (frame.tilt) writeTilt(out, *frame.tilt);
    if (frame.parameters.get() != before) {
      out << ", parameters: {";
      writeTexts(out, changedParameters(*before, *frame.parameters), "", ", ");
      out << "}";
      before = frame.parameters.get();
    }
    out << "}\n";
  }
  return out.str();
}

/// Removes the oldest recordings of a reason but the newest one, which by a clock that was set back
/// may seem to be older, and what is left of one that was interrupted.
void prune(const fs::path& folder, const std::string& reason, const std::string& newest,
           std::size_t keep) {
  const std::regex pattern("(\\d{4}(-\\d\\d){5}-\\d{3}-" + reason +
                           ")\\.(bag|bag\\.part|yaml|state)");
  std::vector<std::string> names;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    const std::string file = entry.path().filename().string();
    std::smatch match;
    if (!std::regex_match(file, match, pattern) || match[1] == newest) continue;
    if (match[3] == "bag.part") {
      fs::remove(entry.path(), error);
    } else {
      names.push_back(match[1]);
    }
  }
  std::sort(names.begin(), names.end());
  names.erase(std::unique(names.begin(), names.end()), names.end());
  const std::size_t too_many = names.size() >= keep ? names.size() + 1 - keep : 0;
  for (std::size_t i = 0; i < too_many; ++i) {
    for (const char* ending : {".bag", ".yaml", ".state"})
      fs::remove(folder / (names[i] + ending), error);
  }
}

RecordingFiles writeAll(const Recording& recording, const RecordingTarget& target,
                        const std::string& reason) {
  const fs::path folder = target.folder();
  fs::create_directories(folder);
  const std::string name = timeName() + "-" + reason;
  const RecordingFiles files{folder / (name + ".bag"), folder / (name + ".yaml"),
                             folder / (name + ".state")};
  Unfinished unfinished;
  writeBag(recording, target, files.bag, &unfinished);
  writeFile(files.state, recording.start->state, &unfinished);
  writeFile(files.yaml, formatYaml(recording, target, files, reason), &unfinished);
  unfinished.keep();
  prune(folder, reason, name, static_cast<std::size_t>(target.parameters.recorder.max_files));
  return files;
}

}  // namespace

fs::path RecordingTarget::folder() const {
  std::string name = node.substr(std::min(node.find_first_not_of('/'), node.size()));
  std::replace(name.begin(), name.end(), '/', '_');
  return rosHome() / parameters.recorder.folder / name;  // an absolute path replaces ROS_HOME
}

RecordingFiles writeRecording(const Recording& recording, const RecordingTarget& target,
                              const std::string& reason) {
  if (recording.frames.empty()) throw std::runtime_error("no frame is recorded yet");
  try {
    return writeAll(recording, target, reason);
  } catch (const std::exception& error) {
    throw std::runtime_error("no recording in '" + target.folder().string() + "': " + error.what() +
                             "; make room on disk, or set recorder/folder to a folder that the "
                             "node may write to");
  }
}

}  // namespace point_line_odometry
