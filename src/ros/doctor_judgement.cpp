#include "ros/doctor_judgement.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "common/join.h"

namespace point_line_odometry {
namespace {

using Level = DoctorLevel;
using Subject = DoctorSubject;

std::string number(double value, int decimals) {
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "%.*f", decimals, value);
  return text.data();
}

std::string milliseconds(double seconds) {
  return number(1e3 * seconds, std::abs(seconds) < 0.1 ? 1 : 0) + " ms";
}

DoctorLine ok(Subject subject, const std::string& text) {
  return {subject, Level::kOk, text, {}, {}};
}

DoctorLine unknown(Subject subject, const std::string& text) {
  return {subject, Level::kUnknown, text, {}, {}};
}

DoctorLine failure(Subject subject, Level level, const std::string& text, const std::string& cure) {
  return {subject, level, text, cure, {}};
}

/// A line of a sentence "fault; cure" or "fault: cure", as the errors of messages are.
DoctorLine failure(Subject subject, const std::string& sentence) {
  std::size_t at = sentence.rfind("; ");
  if (at == std::string::npos) at = sentence.rfind(": ");
  if (at == std::string::npos) return failure(subject, Level::kError, sentence, "see above");
  return failure(subject, Level::kError, sentence.substr(0, at), sentence.substr(at + 2));
}

// --- Topics and stamps

const TopicFacts& topicOf(const DoctorFacts& facts, StereoTopic topic) {
  return facts.input.topics[topic];
}

bool isImage(StereoTopic topic) { return topic == kLeftImage || topic == kRightImage; }

/// What is there instead of a missing image topic, and how to take it.
std::string otherTopics(const DoctorFacts& facts, StereoTopic topic) {
  if (!isImage(topic)) return "";
  if (facts.image_topics.empty()) return facts.from_bag ? "; it has no images at all" : "";
  const std::string other = stereoTopicName(topic, !facts.parameters.rectify);
  const bool other_kind = std::any_of(
      facts.image_topics.begin(), facts.image_topics.end(), [&](const std::string& name) {
        return name.size() >= other.size() &&
               name.compare(name.size() - other.size(), other.size(), other) == 0;
      });
  std::string text = "; images are on " + join(facts.image_topics, ", ");
  for (const std::string& name : facts.image_topics) {
    const std::string& missing = topicOf(facts, topic).name;
    if (name.compare(0, missing.size() + 1, missing + "/") != 0) continue;
    text += facts.from_bag ? ": decompress them into another bag (image_transport republish)"
                           : ": set image_transport to " + name.substr(missing.size() + 1);
    return text;
  }
  if (other_kind) {
    text += facts.parameters.rectify ? ": set rectify to false for rectified ones"
                                     : ": set rectify to true for raw ones";
  }
  return text;
}

std::string cureOfMissing(const DoctorFacts& facts, StereoTopic topic) {
  const TopicFacts& seen = topicOf(facts, topic);
  if (facts.from_bag) {
    return "record it, or name the topics by --ns, --rectify or remapping" +
           otherTopics(facts, topic);
  }
  if (seen.publishers.value_or(0) > 0) {
    return "it is advertised: start or resume what publishes it; if 'rostopic hz' shows it on the "
           "publisher's computer only, set ROS_IP on both computers to addresses they can reach";
  }
  return "start what publishes it, or remap the name or namespace to what is published" +
         otherTopics(facts, topic);
}

DoctorLine examineTopic(const DoctorFacts& facts, Subject subject, StereoTopic topic) {
  constexpr double kShortestSilence_s = 2.0;
  constexpr double kSilentPeriods = 5.0;
  const TopicFacts& seen = topicOf(facts, topic);
  if (seen.messages == 0) {
    return failure(subject, Level::kError, "nothing arrives on " + seen.name,
                   cureOfMissing(facts, topic));
  }
  const double patience_s =
      std::max(kShortestSilence_s, seen.rate_hz > 0.0 ? kSilentPeriods / seen.rate_hz : 0.0);
  const std::string count = seen.name + ": " + std::to_string(seen.messages) + " messages";
  DoctorLine line =
      seen.silent_s > patience_s
          ? failure(subject, Level::kError,
                    count + ", but nothing any more for " + number(seen.silent_s, 1) + " s",
                    "restart this camera, or go on with the bag if it is paused or has ended")
          : ok(subject, count + ", " + number(seen.rate_hz, 1) + " Hz");
  line.values = {{"messages", std::to_string(seen.messages)},
                 {"rate [1/s]", number(seen.rate_hz, 2)}};
  return line;
}

/// Left images that might have become part of a set and did not.
std::uint64_t unpairedOf(const InputFacts& input) {
  const std::uint64_t pairs =
      std::min(input.topics[kLeftImage].messages, input.topics[kRightImage].messages);
  return pairs > input.sets ? pairs - input.sets : 0;
}

DoctorLine failedStamps(const DoctorFacts& facts, const std::string& what, double skew_s) {
  const std::string text = what + " differ by " + milliseconds(skew_s) + " (median)";
  const std::string above = number(skew_s, 4) + " s";
  if (facts.parameters.approximate_sync) {
    return failure(Subject::kStamps, Level::kError, text,
                   "raise approximate_sync_max_interval_s above " + above +
                       ", or trigger both cameras together");
  }
  return failure(Subject::kStamps, Level::kError, text,
                 "trigger both cameras together and give the images and camera_info of a pair the "
                 "same stamp; if the difference is small, set approximate_sync to true and "
                 "approximate_sync_max_interval_s above " +
                     above);
}

DoctorLine judgeStamps(const DoctorFacts& facts) {
  constexpr double kMostUnpaired = 0.2;
  constexpr std::uint64_t kFew = 5;
  const InputFacts& input = facts.input;
  if (!input.image_skew_s) return unknown(Subject::kStamps, "no images of both cameras yet");
  if (input.unstamped) {
    return failure(Subject::kStamps, Level::kError, "messages have the stamp 0",
                   "let the driver stamp images and camera_info with the time of exposure");
  }
  const double most_s =
      facts.parameters.approximate_sync ? facts.parameters.approximate_sync_max_interval_s : 0.0;
  if (*input.image_skew_s > most_s) {
    return failedStamps(facts, "stamps of left and right images", *input.image_skew_s);
  }
  if (!input.info_skew_s) return unknown(Subject::kStamps, "no camera_info of both cameras yet");
  if (*input.info_skew_s > most_s) {
    return failedStamps(facts, "stamps of images and camera_info", *input.info_skew_s);
  }
  const std::uint64_t unpaired = unpairedOf(input);
  const auto pairs = static_cast<double>(input.sets + unpaired);
  if (unpaired > kFew && static_cast<double>(unpaired) > kMostUnpaired * pairs) {
    return failure(Subject::kStamps, Level::kWarn,
                   std::to_string(unpaired) + " of " + number(pairs, 0) +
                       " image pairs lacked an image or camera_info of the same stamp",
                   "look for messages that are lost on the way (rostopic hz of each topic), and "
                   "publish camera_info with every image");
  }
  return ok(Subject::kStamps,
            "left and right " +
                (*input.image_skew_s > 0.0 ? "differ by " + milliseconds(*input.image_skew_s)
                                           : std::string("agree")) +
                ", " + std::to_string(input.sets) + " complete sets");
}

DoctorLine examineStamps(const DoctorFacts& facts) {
  DoctorLine line = judgeStamps(facts);
  const InputFacts& input = facts.input;
  if (input.image_skew_s) {
    line.values.emplace_back("skew of left and right [ms]", number(1e3 * *input.image_skew_s, 3));
  }
  if (input.info_skew_s) {
    line.values.emplace_back("skew of image and camera_info [ms]",
                             number(1e3 * *input.info_skew_s, 3));
  }
  return line;
}

// --- Images and calibration

std::string sizeText(int width, int height) {
  return std::to_string(width) + " x " + std::to_string(height);
}

DoctorLine blank(const char* side, double contrast) {
  return failure(Subject::kImages, Level::kWarn,
                 std::string(side) + " image shows hardly anything: its grey levels spread by " +
                     number(contrast, 1),
                 "look at it (rqt_image_view): lens cap, light, exposure");
}

DoctorLine judgeImages(const DoctorFacts& facts) {
  const auto& [left, right] = facts.images;
  for (const auto& image : {left, right}) {
    if (image && !image->fault.empty()) return failure(Subject::kImages, image->fault);
  }
  if (!left || !right) return unknown(Subject::kImages, "no images of both cameras yet");
  if (left->width != right->width || left->height != right->height) {
    return failure(Subject::kImages, Level::kError,
                   "left images are " + sizeText(left->width, left->height) + ", right ones " +
                       sizeText(right->width, right->height),
                   "run both cameras at the resolution of the calibration");
  }
  if (facts.camera &&
      (facts.camera->width != left->width || facts.camera->height != left->height)) {
    return failure(Subject::kImages, Level::kError,
                   "images are " + sizeText(left->width, left->height) +
                       ", but camera_info describes " +
                       sizeText(facts.camera->width, facts.camera->height),
                   "calibrate for this resolution, or set binning and roi in camera_info");
  }
  if (facts.pair) {
    if (facts.pair->identical) {
      return failure(Subject::kImages, Level::kError, "left and right images are the same",
                     "both topics carry one camera: correct the remapping or the driver's set-up");
    }
    constexpr double kLeastContrast = 4.0;  // more than the noise of a covered lens
    const PairMeasurement& pair = *facts.pair;
    if (pair.contrast_left < kLeastContrast) return blank("left", pair.contrast_left);
    if (pair.contrast_right < kLeastContrast) return blank("right", pair.contrast_right);
  }
  return ok(Subject::kImages, sizeText(left->width, left->height) + " " + left->encoding);
}

DoctorLine examineImages(const DoctorFacts& facts) {
  DoctorLine line = judgeImages(facts);
  for (std::size_t i = 0; i < facts.images.size(); ++i) {
    if (!facts.images[i]) continue;
    const ImageFacts& image = *facts.images[i];
    line.values.emplace_back(i == 0 ? "left image" : "right image",
                             sizeText(image.width, image.height) + " " + image.encoding);
  }
  return line;
}

DoctorLine examineCalibration(const DoctorFacts& facts) {
  if (!facts.calibration_fault.empty()) {
    return failure(Subject::kCalibration, facts.calibration_fault);
  }
  if (!facts.camera) return unknown(Subject::kCalibration, "no camera_info of both cameras yet");
  const StereoCamera& camera = *facts.camera;
  DoctorLine line =
      ok(Subject::kCalibration,
         "fx " + number(camera.fx, 1) + ", fy " + number(camera.fy, 1) + ", cx " +
             number(camera.cx, 1) + ", cy " + number(camera.cy, 1) + " px, " +
             (facts.parameters.rectify ? "rectified here (K, D, R, P)" : "taken as rectified (P)"));
  line.values = {{"fx [px]", number(camera.fx, 3)},
                 {"image width [px]", std::to_string(camera.width)},
                 {"image height [px]", std::to_string(camera.height)}};
  return line;
}

DoctorLine examineBaseline(const DoctorFacts& facts) {
  constexpr double kShortest_m = 0.005;
  constexpr double kLongest_m = 5.0;
  if (!facts.camera) return unknown(Subject::kBaseline, "no usable calibration yet");
  const double baseline_m = facts.camera->baseline_m;
  const std::string text = number(baseline_m, 4) + " m";
  DoctorLine line =
      baseline_m < kShortest_m || baseline_m > kLongest_m
          ? failure(Subject::kBaseline, Level::kWarn, text + ", which hardly any pair has",
                    "calibrate with the size of the target's squares in metres, not millimetres; "
                    "P[3] of right/camera_info must be -fx * baseline")
          : ok(Subject::kBaseline, text);
  line.values = {{"baseline [m]", number(baseline_m, 5)}};
  return line;
}

// --- The measured pair

/// True if the measurement can be judged; else the reason stands in `line`.
std::optional<DoctorLine> withoutMeasurement(const DoctorFacts& facts, Subject subject) {
  if (!facts.pair) return unknown(subject, "no pair of images measured yet");
  constexpr int kFew = PairMeasurement::kFewestMatches;
  if (facts.pair->corners_left < kFew || facts.pair->corners_right < kFew) {
    return unknown(subject, "not measured: too few corners, " +
                                std::to_string(facts.pair->corners_left) + " and " +
                                std::to_string(facts.pair->corners_right));
  }
  if (facts.pair->identical) return unknown(subject, "not measured: both images are the same");
  return std::nullopt;
}

const char* rectificationCure(const DoctorFacts& facts) {
  return facts.parameters.rectify
             ? "calibrate the pair again (camera_calibration), and check that camera_info is of "
               "these cameras and not exchanged"
             : "subscribe to rectified images (stereo_image_proc), or set rectify to true if these "
               "are raw; if they are rectified, calibrate the pair again";
}

DoctorLine judgeRectification(const DoctorFacts& facts) {
  constexpr int kPlentyOfCorners = 150;  // of these some match, unless something is wrong
  if (const auto line = withoutMeasurement(facts, Subject::kRectification)) return *line;
  const PairMeasurement& pair = *facts.pair;
  if (!pair.valid() && std::min(pair.corners_left, pair.corners_right) < kPlentyOfCorners) {
    return unknown(Subject::kRectification, "not measured: " + std::to_string(pair.matches) +
                                                " points match, of " +
                                                std::to_string(pair.corners_left) + " and " +
                                                std::to_string(pair.corners_right) + " corners");
  }
  if (!pair.valid()) {
    return failure(Subject::kRectification, Level::kWarn,
                   "points of the left image are not found in the right one, not even in rows far "
                   "off (" +
                       std::to_string(pair.corners_left) + " and " +
                       std::to_string(pair.corners_right) + " corners)",
                   "check that both cameras look the same way, at the same time, and that both "
                   "are sharp and none is mounted upside down");
  }
  const std::string text = "matched points lie " + number(pair.row_distance_px, 2) +
                           " px apart in row (median of " + std::to_string(pair.matches) +
                           ", right lower by " + number(pair.row_offset_px, 2) + ")";
  if (pair.row_distance_px > kMaxRowDistance_px) {
    return failure(Subject::kRectification, Level::kWarn, "images are not rectified: " + text,
                   rectificationCure(facts));
  }
  if (facts.row_drift_px && std::abs(*facts.row_drift_px) > kMaxRowDrift_px) {
    return failure(Subject::kRectification, Level::kWarn,
                   "the rectification has drifted by " + number(*facts.row_drift_px, 2) +
                       " px in row since the start: " + text,
                   "fasten the cameras and calibrate the pair again");
  }
  return ok(Subject::kRectification, text);
}

DoctorLine examineRectification(const DoctorFacts& facts) {
  DoctorLine line = judgeRectification(facts);
  if (facts.pair && facts.pair->valid()) {
    line.values = {{"row distance of matched points [px]", number(facts.pair->row_distance_px, 3)},
                   {"row difference left to right [px]", number(facts.pair->row_offset_px, 3)},
                   {"matched points", std::to_string(facts.pair->matches)}};
    if (facts.row_drift_px) {
      line.values.emplace_back("drift of row difference [px]", number(*facts.row_drift_px, 3));
    }
  }
  return line;
}

DoctorLine judgeDisparity(const DoctorFacts& facts) {
  constexpr double kExchanged = 0.7;
  constexpr double kTooMany = 0.25;
  if (const auto line = withoutMeasurement(facts, Subject::kDisparity)) return *line;
  const PairMeasurement& pair = *facts.pair;
  if (!pair.valid()) return unknown(Subject::kDisparity, "not measured: no points match");
  const std::string text = "median " + number(pair.disparity_px, 1) + " px";
  const std::string share = number(100.0 * pair.behind_infinity_share, 0) + " % are negative";
  if (pair.behind_infinity_share > kExchanged) {
    return failure(Subject::kDisparity, Level::kError,
                   text + ", " + share + ": left and right cameras are swapped",
                   "exchange the image topics (with their camera_info) or the cameras' cables");
  }
  if (pair.behind_infinity_share > kTooMany) {
    return failure(Subject::kDisparity, Level::kWarn,
                   text + ", " + share + ": these points would lie behind infinity",
                   "calibrate the pair again: the cameras' angle to each other, or cx in P, is "
                   "wrong; images must be rectified");
  }
  return ok(Subject::kDisparity, text + ", left camera is left");
}

DoctorLine examineDisparity(const DoctorFacts& facts) {
  DoctorLine line = judgeDisparity(facts);
  if (facts.pair && facts.pair->valid()) {
    line.values = {
        {"disparity [px]", number(facts.pair->disparity_px, 2)},
        {"negative disparities [%]", number(100.0 * facts.pair->behind_infinity_share, 1)}};
  }
  return line;
}

// --- Place on the robot, time, clock

std::string mountingText(const Eigen::Isometry3d& T_base_camera) {
  const Eigen::Vector3d p = T_base_camera.translation();
  const Eigen::Vector3d forward = T_base_camera.linear().col(2);
  return "at (" + number(p.x(), 2) + ", " + number(p.y(), 2) + ", " + number(p.z(), 2) +
         ") m, looks along (" + number(forward.x(), 2) + ", " + number(forward.y(), 2) + ", " +
         number(forward.z(), 2) + ")";
}

DoctorLine examineMounting(const DoctorFacts& facts) {
  const std::string& base = facts.parameters.base_frame_id;
  const std::string& camera = facts.camera_frame;
  if (!facts.input.latest.left) return unknown(Subject::kMounting, "no left image yet");
  if (camera.empty()) {
    return failure(Subject::kMounting, Level::kError, "frame_id of the left images is empty",
                   "set it in the driver to the camera's optical frame");
  }
  if (camera == base) return ok(Subject::kMounting, "pose of the camera itself, " + camera);
  if (!facts.T_base_camera) {
    return failure(Subject::kMounting, facts.from_bag ? Level::kWarn : Level::kError,
                   "no transform from " + base + " to " + camera +
                       (facts.from_bag ? " in the bag" : ": frames wait for it"),
                   "publish it, for example 'rosrun tf2_ros static_transform_publisher X Y Z "
                   "-1.5708 0 -1.5708 " +
                       base + " " + camera + "', or set base_frame_id to " + camera);
  }
  const std::string text = base + " to " + camera + ": " + mountingText(*facts.T_base_camera);
  if (facts.T_base_camera->linear().isIdentity(1e-6)) {
    return failure(Subject::kMounting, Level::kWarn, text + ", straight up",
                   "give the transform the rotation of an optical frame, x right, y down, z "
                   "forward: yaw -1.5708, pitch 0, roll -1.5708 for a camera that looks ahead");
  }
  return ok(Subject::kMounting, text);
}

DoctorLine examineSpeed(const DoctorFacts& facts) {
  const double rate_hz = facts.input.set_rate_hz;
  if (!facts.frame_ms || rate_hz <= 0.0) {
    return unknown(Subject::kSpeed, "fewer than two frames processed yet");
  }
  const double period_ms = 1e3 / rate_hz;
  const std::string text =
      number(*facts.frame_ms, 1) + " ms per frame, one comes every " + number(period_ms, 1) + " ms";
  DoctorLine line =
      *facts.frame_ms > period_ms
          ? failure(Subject::kSpeed, Level::kWarn, text,
                    "raise tracking/threads if there are more cores, set target_frame_time_ms, or "
                    "lower points/max_per_cell, lines/max_count and window/size")
          : ok(Subject::kSpeed, text);
  line.values = {{"time per frame [ms]", number(*facts.frame_ms, 2)},
                 {"period of frames [ms]", number(period_ms, 2)}};
  return line;
}

DoctorLine examineClock(const DoctorFacts& facts) {
  if (facts.clock_stands) {
    return failure(Subject::kClock, Level::kWarn, "use_sim_time is set, but no /clock arrives",
                   "play bags with 'rosbag play --clock', or unset /use_sim_time and start again");
  }
  return ok(Subject::kClock, facts.from_bag ? "that of the bag" : "ticks");
}

}  // namespace

std::vector<DoctorLine> examineTopics(const DoctorFacts& facts) {
  return {examineTopic(facts, Subject::kLeftImage, kLeftImage),
          examineTopic(facts, Subject::kRightImage, kRightImage),
          examineTopic(facts, Subject::kLeftInfo, kLeftInfo),
          examineTopic(facts, Subject::kRightInfo, kRightInfo), examineStamps(facts)};
}

std::vector<DoctorLine> examine(const DoctorFacts& facts) {
  std::vector<DoctorLine> lines = examineTopics(facts);
  for (const auto& next : {examineImages, examineCalibration, examineBaseline, examineRectification,
                           examineDisparity, examineMounting, examineSpeed, examineClock}) {
    lines.push_back(next(facts));
  }
  return lines;
}

}  // namespace point_line_odometry
