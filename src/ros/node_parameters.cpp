#include "ros/node_parameters.h"

#include <cmath>
#include <utility>

#include "common/parameter_checker.h"

namespace point_line_odometry {
namespace {

struct NameCollector {
  std::vector<std::string> names;

  template <typename... Rest>
  void operator()(const char* name, const Rest&...) {
    names.emplace_back(name);
  }
};

}  // namespace

std::vector<std::string> nodeParameterNames() {
  NameCollector collector;
  const NodeParameters defaults;
  visitNodeParameters(defaults, collector);
  return collector.names;
}

std::vector<std::string> checkNodeParameters(const NodeParameters& parameters) {
  ParameterChecker checker;
  visitNodeParameters(parameters, checker);
  if (parameters.odom_frame_id == parameters.base_frame_id) {
    checker.errors.emplace_back("odom_frame_id and base_frame_id are the same, but must differ");
  }
  for (const auto& [name, frame] :
       {std::pair<const char*, const std::string&>{"odom_frame_id", parameters.odom_frame_id},
        {"base_frame_id", parameters.base_frame_id},
        {"guess_frame_id", parameters.guess_frame_id}}) {
    if (!frame.empty() && frame.front() == '/')
      checker.errors.emplace_back(std::string(name) + ": '" + frame +
                                  "' begins with a slash, but tf2 has no such frames; set '" +
                                  frame.substr(1) + "'");
  }
  if (usesTfGuess(parameters) && (parameters.guess_frame_id == parameters.base_frame_id ||
                                  parameters.guess_frame_id == parameters.odom_frame_id)) {
    checker.errors.emplace_back(
        "guess_frame_id is base_frame_id or odom_frame_id, but must be the frame of another "
        "odometry");
  }
  return checker.errors;
}

bool usesTfGuess(const NodeParameters& parameters) { return parameters.guess_frame_id != kNoFrame; }

bool usesWheels(const AllParameters& parameters) {
  return parameters.core.wheels.enabled || usesTfGuess(parameters.node);
}

std::size_t pairsWhile(double seconds) {
  constexpr double kFastestCamera_hz = 100.0;
  return static_cast<std::size_t>(std::ceil(seconds * kFastestCamera_hz));
}

bool expectsMask(const NodeParameters& parameters, std::size_t camera) {
  return parameters.mask_images == "both" ||
         parameters.mask_images == (camera == 0 ? "left" : "right");
}

Eigen::Isometry3d initialPose(const NodeParameters& parameters) {
  const auto& pose = parameters.initial_pose;
  Eigen::Isometry3d T_odom_base = Eigen::Isometry3d::Identity();
  T_odom_base.linear() = (Eigen::AngleAxisd(pose.yaw, Eigen::Vector3d::UnitZ()) *
                          Eigen::AngleAxisd(pose.pitch, Eigen::Vector3d::UnitY()) *
                          Eigen::AngleAxisd(pose.roll, Eigen::Vector3d::UnitX()))
                             .toRotationMatrix();
  T_odom_base.translation() = Eigen::Vector3d(pose.x, pose.y, pose.z);
  return T_odom_base;
}

}  // namespace point_line_odometry
