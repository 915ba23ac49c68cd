#include "ros/doctor_rules.h"

#include <algorithm>
#include <optional>
#include <string>

#include "ros/doctor_camera.h"
#include "ros/doctor_lines.h"
#include "ros/doctor_sequence.h"
#include "ros/doctor_topics.h"

namespace point_line_odometry {
namespace {

using Level = DoctorLevel;
using Subject = DoctorSubject;

std::string mountingText(const Eigen::Isometry3d& T_base_camera) {
  const Eigen::Vector3d p = T_base_camera.translation();
  const Eigen::Vector3d forward = T_base_camera.linear().col(2);
  return "at (" + number(p.x(), 2) + ", " + number(p.y(), 2) + ", " + number(p.z(), 2) +
         ") m, optical axis along (" + number(forward.x(), 2) + ", " + number(forward.y(), 2) +
         ", " + number(forward.z(), 2) + ")";
}

/// How the camera's pose in the base gets known to tf.
std::string hintForMounting(const DoctorFacts& facts) {
  const std::string& base = facts.parameters.base_frame_id;
  const std::string& topmost = facts.topmost_frame;
  if (topmost != facts.camera_frame) {
    return facts.camera_frame + " hangs below " + topmost + ": publish the transform from " + base +
           " to " + topmost + ", or set base_frame_id to " + topmost;
  }
  return "publish it, for example 'rosrun tf2_ros static_transform_publisher X Y Z -1.5708 0 "
         "-1.5708 " +
         base + " " + facts.camera_frame + "', or set base_frame_id to " + facts.camera_frame;
}

/// A frame that the odometry publishes, and another node, too.
DoctorLine conflictLine(const DoctorFacts& facts, const TfEdge& own) {
  const TfParents::Source& other = facts.other_parents.front();
  std::string hint =
      "a frame of tf has one parent and one publisher: let one of the two not publish "
      "it (publish_tf: false)";
  if (own.child == facts.parameters.base_frame_id && other.parent != own.parent) {
    hint += ", set base_frame_id to the topmost frame of the robot, " + facts.topmost_of_other +
            ", or invert_tf to true";
  }
  return failureLine(Subject::kMounting, facts.odometry_runs ? Level::kError : Level::kWarn,
                     other.publisher + " publishes the pose of " + own.child + " in " +
                         other.parent + ", as this odometry does in " + own.parent,
                     hint);
}

DoctorLine checkMounting(const DoctorFacts& facts) {
  const std::string& base = facts.parameters.base_frame_id;
  const std::string& camera = facts.camera_frame;
  if (!facts.input.latest.left) return unknownLine(Subject::kMounting, "no left image yet");
  if (camera.empty()) {
    return failureLine(Subject::kMounting, Level::kError, "frame_id of the left images is empty",
                       "set it in the driver to the camera's optical frame");
  }
  const std::optional<TfEdge> own = transformOfOdometry(facts.parameters);
  if (own && !facts.other_parents.empty()) return conflictLine(facts, *own);
  if (camera == base) return okLine(Subject::kMounting, "pose of the camera itself, " + camera);
  if (!facts.T_base_camera) {
    return failureLine(Subject::kMounting, facts.from_bag ? Level::kWarn : Level::kError,
                       "no transform from " + base + " to " + camera +
                           (facts.from_bag ? " in the bag" : ": frames wait for it"),
                       hintForMounting(facts));
  }
  const std::string text = base + " to " + camera + ": " + mountingText(*facts.T_base_camera);
  if (facts.T_base_camera->linear().isIdentity(1e-6)) {
    return failureLine(Subject::kMounting, Level::kWarn, text + ", straight up",
                       "give the transform the rotation of an optical frame, x right, y down, z "
                       "forward: yaw -1.5708, pitch 0, roll -1.5708 for a camera that looks ahead");
  }
  return okLine(Subject::kMounting, text);
}

bool usesMasks(const NodeParameters& p) {
  return p.left.mask != kNoMask || p.right.mask != kNoMask || p.mask_images != "none";
}

DoctorLine evaluateMasks(const DoctorFacts& facts) {
  const MaskFacts& masks = *facts.masks;
  const auto percent = [](double share) { return number(100.0 * share, 0) + " %"; };
  const std::string text = percent(masks.left_share) + " of the left and " +
                           percent(masks.right_share) + " of the right image ignored";
  if (!masks.fault.empty()) {
    return failureLine(Subject::kMasks, Level::kWarn, "a mask was not used: " + masks.fault,
                       "publish masks as mono8, of the size of the images");
  }
  const auto expected =
      static_cast<double>(masks.frames) *
      ((expectsMask(facts.parameters, 0) ? 1 : 0) + (expectsMask(facts.parameters, 1) ? 1 : 0));
  constexpr double kManyMissing = 0.1;
  if (static_cast<double>(masks.missing) > kManyMissing * expected) {
    return failureLine(
        Subject::kMasks, Level::kWarn,
        std::to_string(masks.missing) + " of " + number(expected, 0) +
            " masks did not come in time",
        "see that something publishes left/mask_image or right/mask_image, each with "
        "the exact stamp of its image, or raise mask_wait_s");
  }
  constexpr double kMost = 0.8;
  if (std::max(masks.left_share, masks.right_share) > kMost) {
    return failureLine(Subject::kMasks, Level::kWarn, text,
                       "little of the scene remains: pixels to be ignored are 0, all others not");
  }
  if (masks.rim.isWorseNearRim().value_or(false)) {
    return failureLine(Subject::kMasks, Level::kWarn,
                       text + "; near its rim only " + percent(masks.rim.near().agreeing()) +
                           " of the points agree with the motion, elsewhere " +
                           percent(masks.rim.elsewhere().agreeing()),
                       "enlarge the mask: what it is to hide is seen beside it");
  }
  return okLine(Subject::kMasks, text);
}

DoctorLine checkMasks(const DoctorFacts& facts) {
  if (!facts.mask_fault.empty()) return failureLine(Subject::kMasks, facts.mask_fault);
  if (!facts.masks || facts.masks->frames == 0) {
    return unknownLine(Subject::kMasks, "no frame processed yet");
  }
  const MaskFacts& masks = *facts.masks;
  DoctorLine line = evaluateMasks(facts);
  line.values = {
      {"left image ignored [%]", number(100.0 * masks.left_share, 1)},
      {"right image ignored [%]", number(100.0 * masks.right_share, 1)},
      {"masks missing", std::to_string(masks.missing)},
      {"points agreeing near the rim [%]", number(100.0 * masks.rim.near().agreeing(), 1)},
      {"points agreeing elsewhere [%]", number(100.0 * masks.rim.elsewhere().agreeing(), 1)}};
  return line;
}

/// Of a node's IMU or wheels.
DoctorLine checkSource(Subject subject, const std::string& name, const SourceFacts& source) {
  const std::string fault = faultOf(name, source);
  if (fault.empty()) return okLine(subject, std::to_string(source.counts.received) + " " + name);
  DoctorLine line = failureLine(subject, fault);
  line.level = Level::kWarn;
  return line;
}

DoctorLine checkSpeed(const DoctorFacts& facts) {
  const double rate_hz = facts.input.set_rate_hz;
  if (!facts.frame_ms || rate_hz <= 0.0) {
    return unknownLine(Subject::kSpeed, "fewer than two frames processed yet");
  }
  const double period_ms = 1e3 / rate_hz;
  const std::string text =
      number(*facts.frame_ms, 1) + " ms per frame, one comes every " + number(period_ms, 1) + " ms";
  DoctorLine line =
      *facts.frame_ms > period_ms
          ? failureLine(
                Subject::kSpeed, Level::kWarn, text,
                "raise tracking/threads if there are more cores, set target_frame_time_ms, or "
                "lower points/max_per_cell, lines/max_count and window/size")
          : okLine(Subject::kSpeed, text);
  line.values = {{"time per frame [ms]", number(*facts.frame_ms, 2)},
                 {"period of frames [ms]", number(period_ms, 2)}};
  return line;
}

DoctorLine checkClock(const DoctorFacts& facts) {
  if (facts.clock_missing) {
    return failureLine(
        Subject::kClock, Level::kError,
        "use_sim_time is set, as by the demo and replay.launch, but no /clock arrives",
        kHintForClock);
  }
  return okLine(Subject::kClock, facts.from_bag ? "that of the bag" : "ticks");
}

}  // namespace

std::vector<DoctorLine> checkInput(const DoctorFacts& facts) {
  std::vector<DoctorLine> lines = checkTopics(facts);
  for (const DoctorLine& line : checkCamera(facts)) lines.push_back(line);
  if (facts.sequence) {
    for (const DoctorLine& line : checkSequence(*facts.sequence)) lines.push_back(line);
  }
  lines.push_back(checkMounting(facts));
  if (usesMasks(facts.parameters)) lines.push_back(checkMasks(facts));
  if (facts.imu) lines.push_back(checkImu(*facts.imu));
  if (facts.imu_source)
    lines.push_back(checkSource(Subject::kImu, "imu samples", *facts.imu_source));
  if (facts.wheels_source)
    lines.push_back(checkSource(Subject::kWheels, "poses by wheels", *facts.wheels_source));
  lines.push_back(checkSpeed(facts));
  lines.push_back(checkClock(facts));
  return lines;
}

}  // namespace point_line_odometry
