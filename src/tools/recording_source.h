#pragma once

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <boost/crc.hpp>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "point_line_odometry/stereo_odometry.h"
#include "tools/bag_source.h"
#include "tools/parameter_text.h"
#include "tools/stereo_source.h"

namespace point_line_odometry {

/// What the flight recorder wrote beside the images: all that is needed to process them again with
/// the same result, and that result.
struct RecordedRun {
  struct Frame {
    std::int64_t stamp_ns = 0;
    std::string state;
    std::string reason;
    Eigen::Isometry3d T_odom_camera = Eigen::Isometry3d::Identity();
    std::optional<Parameters> parameters;  ///< that came into force with this frame
  };

  std::string bag;
  StereoTopics topics;
  std::int64_t max_interval_ns = 0;
  std::string state;  ///< see StereoOdometry::saveState()
  Parameters parameters;
  std::vector<Frame> frames;
};

/// True for the yaml of a recording, by its name.
inline bool isRecordingName(const std::string& input) {
  return std::filesystem::path(input).extension() == ".yaml";
}

/// Reads the yaml of a recording, and the state beside it.
class RecordingReader {
 public:
  /// Throws InputError if the file or what it names is not there, damaged or of another kind.
  static RecordedRun read(const std::string& file) {
    try {
      return RecordingReader(file).run();
    } catch (const YAML::Exception& error) {
      throw InputError("recording '" + file + "' cannot be read: " + error.what());
    } catch (const InputError& error) {
      throw InputError("recording '" + file + "': " + error.what());
    }
  }

 private:
  explicit RecordingReader(const std::string& file)
      : folder_(std::filesystem::path(file).parent_path()), root_(YAML::LoadFile(file)) {}

  RecordedRun run() const {
    RecordedRun run;
    run.bag = (folder_ / root_["bag"].as<std::string>()).string();
    run.topics = {root_["left_topic"].as<std::string>(), root_["right_topic"].as<std::string>()};
    run.max_interval_ns = std::llround(1e9 * root_["max_interval_s"].as<double>());
    run.state = readState(root_["state"]);
    run.parameters = applySettings(Parameters(), settings(root_["parameters"]));
    Parameters in_force = run.parameters;
    for (const YAML::Node& frame : root_["frames"]) {
      run.frames.push_back(readFrame(frame));
      if (!frame["parameters"]) continue;
      in_force = applySettings(in_force, settings(frame["parameters"]));
      run.frames.back().parameters = in_force;
    }
    return run;
  }

  static RecordedRun::Frame readFrame(const YAML::Node& node) {
    RecordedRun::Frame frame;
    frame.stamp_ns = node["stamp_ns"].as<std::int64_t>();
    frame.state = node["state"].as<std::string>();
    frame.reason = node["reason"].as<std::string>();
    const auto numbers = node["T_odom_camera"].as<std::vector<double>>();
    if (numbers.size() != 12) throw InputError("a pose has not 12 numbers");
    frame.T_odom_camera.matrix().topRows<3>() =
        Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(numbers.data());
    return frame;
  }

  static std::vector<std::string> settings(const YAML::Node& parameters) {
    std::vector<std::string> settings;
    for (const auto& entry : parameters)
      settings.push_back(entry.first.as<std::string>() + "=" + entry.second.as<std::string>());
    return settings;
  }

  std::string readState(const YAML::Node& node) const {
    const std::string file = (folder_ / node["file"].as<std::string>()).string();
    std::ifstream in(file, std::ios::binary);
    if (!in) throw InputError("'" + file + "' is missing: keep bag, yaml and state together");
    std::string state{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
    boost::crc_32_type crc;
    crc.process_bytes(state.data(), state.size());
    if (crc.checksum() != node["crc32"].as<std::uint32_t>())
      throw InputError("'" + file + "' is damaged, or of another recording: fetch it again");
    return state;
  }

  std::filesystem::path folder_;
  YAML::Node root_;
};

/// How far a replay is from what was recorded.
struct RecordingComparison {
  std::size_t frames = 0;  ///< that are in both
  std::size_t equal = 0;   ///< with the same state, reason and bits of the pose
  double max_distance_m = 0.0;
  double max_angle_rad = 0.0;

  void add(const RecordedRun::Frame& recorded, const FrameResult& replayed) {
    const Eigen::Isometry3d difference = recorded.T_odom_camera.inverse() * replayed.T_odom_camera;
    ++frames;
    if (recorded.T_odom_camera.matrix() == replayed.T_odom_camera.matrix() &&
        recorded.state == toString(replayed.state) && recorded.reason == toString(replayed.reason))
      ++equal;
    max_distance_m = std::max(max_distance_m, difference.translation().norm());
    max_angle_rad = std::max(max_angle_rad, Eigen::AngleAxisd(difference.linear()).angle());
  }
};

/// Puts an odometry back to where a recording begins, gives it the parameters that came into force
/// on the way, and compares.
class RecordingReplay {
 public:
  explicit RecordingReplay(RecordedRun run) : run_(std::move(run)) {
    for (std::size_t i = 0; i < run_.frames.size(); ++i) by_stamp_[run_.frames[i].stamp_ns] = i;
  }

  /// Throws InputError if the state cannot be used.
  /// \param instead parameters to be used all the way instead of the recorded ones.
  void begin(const std::optional<Parameters>& instead, StereoOdometry* odometry) {
    try {
      odometry->restoreState(run_.state);
    } catch (const std::invalid_argument& error) {
      throw InputError(error.what());
    }
    own_parameters_ = instead.has_value();
    if (instead) odometry->setParameters(*instead);
  }

  /// To be called before a frame is processed.
  void prepare(std::int64_t stamp_ns, StereoOdometry* odometry) const {
    const RecordedRun::Frame* frame = find(stamp_ns);
    if (frame != nullptr && frame->parameters && !own_parameters_)
      odometry->setParameters(*frame->parameters);
  }

  /// To be called after that.
  void compare(const FrameResult& result) {
    const RecordedRun::Frame* frame = find(result.stamp_ns);
    if (frame != nullptr) comparison_.add(*frame, result);
  }

  const RecordedRun& run() const { return run_; }
  const RecordingComparison& comparison() const { return comparison_; }

 private:
  const RecordedRun::Frame* find(std::int64_t stamp_ns) const {
    const auto found = by_stamp_.find(stamp_ns);
    return found == by_stamp_.end() ? nullptr : &run_.frames[found->second];
  }

  RecordedRun run_;
  std::map<std::int64_t, std::size_t> by_stamp_;
  RecordingComparison comparison_;
  bool own_parameters_ = false;
};

}  // namespace point_line_odometry
