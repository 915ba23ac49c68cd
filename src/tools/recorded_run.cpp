#include "tools/recorded_run.h"

#include <yaml-cpp/yaml.h>

#include <boost/crc.hpp>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "common/input_error.h"
#include "common/recording_format.h"
#include "point_line_odometry/version.h"
#include "tools/parameter_text.h"

namespace point_line_odometry {
namespace {

template <int kRows, int kColumns>
Eigen::Matrix<double, kRows, kColumns> readMatrix(const YAML::Node& node) {
  const auto numbers = node.as<std::vector<double>>();
  if (numbers.size() != kRows * kColumns)
    throw InputError("a matrix has not " + std::to_string(kRows * kColumns) + " numbers");
  Eigen::Matrix<double, kRows, kColumns> matrix;
  for (int i = 0; i < kRows * kColumns; ++i)
    matrix(i / kColumns, i % kColumns) = numbers[static_cast<std::size_t>(i)];
  return matrix;
}

MotionPrior readPrior(const YAML::Node& node) {
  MotionPrior prior;
  prior.from_ns = node["from_ns"].as<std::int64_t>();
  prior.to_ns = node["to_ns"].as<std::int64_t>();
  prior.T_prev_curr.matrix().topRows<3>() = readMatrix<3, 4>(node["T_prev_curr"]);
  prior.information = readMatrix<6, 6>(node["information"]);
  return prior;
}

TiltCorrection readTilt(const YAML::Node& node) {
  TiltCorrection tilt;
  tilt.up = readMatrix<3, 1>(node["up"]);
  tilt.rotation = readMatrix<3, 1>(node["rotation"]);
  tilt.covariance = readMatrix<3, 3>(node["covariance"]);
  return tilt;
}

RecordedRun::Frame readFrame(const YAML::Node& node) {
  RecordedRun::Frame frame;
  frame.stamp_ns = node["stamp_ns"].as<std::int64_t>();
  frame.state = node["state"].as<std::string>();
  frame.reason = node["reason"].as<std::string>();
  frame.T_odom_camera.matrix().topRows<3>() = readMatrix<3, 4>(node["T_odom_camera"]);
  if (node["prior"]) frame.prior = readPrior(node["prior"]);
  if (node["tilt"]) frame.tilt = readTilt(node["tilt"]);
  return frame;
}

std::vector<std::string> settings(const YAML::Node& parameters) {
  std::vector<std::string> settings;
  for (const auto& entry : parameters)
    settings.push_back(entry.first.as<std::string>() + "=" + entry.second.as<std::string>());
  return settings;
}

std::string readState(const std::filesystem::path& folder, const YAML::Node& node) {
  const std::string file = (folder / node["file"].as<std::string>()).string();
  std::ifstream in(file, std::ios::binary);
  if (!in) throw InputError("'" + file + "' is missing: keep bag, yaml and state together");
  std::string state{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  boost::crc_32_type crc;
  crc.process_bytes(state.data(), state.size());
  if (crc.checksum() != node["crc32"].as<std::uint32_t>())
    throw InputError("'" + file + "' is damaged, or of another recording: fetch it again");
  return state;
}

/// Throws InputError for a format of a later version.
void requireKnownFormat(const YAML::Node& root) {
  const int format = root["format"] ? root["format"].as<int>() : 1;
  if (format >= 1 && format <= kRecordingFormat) return;
  throw InputError("is of format " + std::to_string(format) + ", written by version " +
                   root["version"].as<std::string>("?") +
                   " of point_line_odometry; this is version " + version() +
                   ", which reads format 1 to " + std::to_string(kRecordingFormat) +
                   ": replay it with the version that wrote it, or a later one");
}

RecordedRun readRun(const std::filesystem::path& folder, const YAML::Node& root) {
  requireKnownFormat(root);
  RecordedRun run;
  run.version = root["version"].as<std::string>("?");
  run.bag = (folder / root["bag"].as<std::string>()).string();
  run.topics = {root["left_topic"].as<std::string>(), root["right_topic"].as<std::string>()};
  run.max_interval_ns = std::llround(1e9 * root["max_interval_s"].as<double>());
  run.has_masks = root["masks"] && root["masks"].as<bool>();
  run.state = readState(folder, root["state"]);
  run.parameters = applySettings(Parameters(), settings(root["parameters"]), &run.warnings);
  Parameters in_force = run.parameters;
  for (const YAML::Node& frame : root["frames"]) {
    run.frames.push_back(readFrame(frame));
    if (!frame["parameters"]) continue;
    in_force = applySettings(in_force, settings(frame["parameters"]), &run.warnings);
    run.frames.back().parameters = in_force;
  }
  return run;
}

}  // namespace

bool isRecordingName(const std::string& input) {
  return std::filesystem::path(input).extension() == ".yaml";
}

RecordedRun readRecording(const std::string& file) {
  try {
    return readRun(std::filesystem::path(file).parent_path(), YAML::LoadFile(file));
  } catch (const YAML::Exception& error) {
    throw InputError("recording '" + file + "' cannot be read: " + error.what());
  } catch (const InputError& error) {
    throw InputError("recording '" + file + "': " + error.what());
  }
}

}  // namespace point_line_odometry
