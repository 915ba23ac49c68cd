#include "ros/doctor_camera.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>

#include "ros/doctor_lines.h"

namespace point_line_odometry {
namespace {

using Level = DoctorLevel;
using Subject = DoctorSubject;

/// Median vertical disparity of matched points above which a pair is reported as not rectified.
constexpr double kMaxVerticalDisparity_px = 1.5;

/// Change of the median vertical disparity since the start above which a drift is reported.
constexpr double kMaxVerticalDrift_px = 0.5;

/// Correction of the disparities by the odometry above which the right camera is reported to have
/// moved, as an angle: a pixel of KITTI's camera, whose calibration needs 0.7 px.
constexpr double kMaxCorrection_rad = 0.0014;

// --- Images and calibration

std::string sizeText(int width, int height) {
  return std::to_string(width) + " x " + std::to_string(height);
}

DoctorLine blank(const char* side, double contrast) {
  return failureLine(
      Subject::kImages, Level::kWarn,
      std::string(side) +
          " image has hardly any contrast: the standard deviation of its grey levels is " +
          number(contrast, 1),
      "look at it (rqt_image_view): lens cap, light, exposure");
}

/// One image brighter than the other, by more than half a stop: the darker one then has a third
/// more noise at the same contrast, and the brighter one is the first to saturate. Lenses and
/// sensors of one make differ by less than a quarter.
std::optional<DoctorLine> unequalExposure(const PairMeasurement& pair) {
  constexpr double kLargestRatio = 1.42;
  if (!pair.valid()) return std::nullopt;
  const bool right_is_brighter = pair.brightness_ratio > 1.0;
  const double ratio = right_is_brighter ? pair.brightness_ratio : 1.0 / pair.brightness_ratio;
  if (ratio <= kLargestRatio) return std::nullopt;
  return failureLine(Subject::kImages, Level::kWarn,
                     std::string("the ") + (right_is_brighter ? "right" : "left") + " image is " +
                         number(ratio, 1) + " times as bright as the other at matched points",
                     "let one camera set exposure and gain of both, or fix them: the two must not "
                     "have an auto-exposure each");
}

/// Part of one image without the contrast of the other one, and hardly any such part of that.
std::optional<DoctorLine> obscuredLens(const PairMeasurement& pair) {
  constexpr double kLeastShare = 0.03;
  constexpr double kTimesTheOther = 3.0;  // more than what things before a plain wall do to both
  if (!pair.valid()) return std::nullopt;
  const bool left = pair.obscured_left > pair.obscured_right;
  const double more = std::max(pair.obscured_left, pair.obscured_right);
  const double less = std::min(pair.obscured_left, pair.obscured_right);
  if (more < kLeastShare || more < kTimesTheOther * less) return std::nullopt;
  const std::string side = left ? "left" : "right";
  return failureLine(
      Subject::kImages, Level::kWarn,
      "the " + side + " image has less than a third of the other one's contrast in " +
          number(100.0 * more, 0) + " % of its area",
      "clean the " + side +
          " lens, look for what covers a part of it, and focus it; mask what is part "
          "of the robot");
}

/// Halves of an image that shows both cameras side by side, cut elsewhere than between the two.
DoctorLine wrongCut(int column) {
  return failureLine(Subject::kImages, Level::kError,
                     "both images have a seam from top to bottom at column " +
                         std::to_string(column) +
                         ": they are halves of a side-by-side image, cut at the wrong column",
                     "set the driver to a size that has both images whole, twice as wide as one, "
                     "with the border of the two in the middle");
}

/// What is wrong with the contents of a pair, the worst first.
std::optional<DoctorLine> pairFault(const PairMeasurement& pair) {
  constexpr double kLeastContrast = 4.0;  // more than the noise of a covered lens
  if (pair.identical) {
    return failureLine(
        Subject::kImages, Level::kError, "left and right images are the same",
        "both topics carry one camera: correct the remapping or the driver's set-up");
  }
  if (pair.contrast_left < kLeastContrast) return blank("left", pair.contrast_left);
  if (pair.contrast_right < kLeastContrast) return blank("right", pair.contrast_right);
  if (auto line = unequalExposure(pair)) return line;
  return obscuredLens(pair);
}

/// Images that come again with another stamp.
std::optional<DoctorLine> repeatedImages(const SequenceMeasurement& sequence) {
  const int left = sequence.repeated_left;
  const int right = sequence.repeated_right;
  if (left + right == 0) return std::nullopt;
  return failureLine(
      Subject::kImages, Level::kWarn,
      std::to_string(left) + " left and " + std::to_string(right) + " right images of " +
          std::to_string(sequence.pairs) +
          " pairs are those of the pair before, byte for byte, while others are not",
      "the driver hands out a buffer twice: lower the frame rate or the resolution to what the "
      "camera and its bus give, and update the driver");
}

/// What is wrong with the contents of the images, the worst first.
std::optional<DoctorLine> contentsFault(const DoctorFacts& facts) {
  const bool identical = facts.pair && facts.pair->identical;
  if (facts.seam_column && !identical) return wrongCut(*facts.seam_column);
  if (facts.pair) {
    if (auto line = pairFault(*facts.pair)) return line;
  }
  return facts.sequence ? repeatedImages(*facts.sequence) : std::nullopt;
}

DoctorLine evaluateImages(const DoctorFacts& facts) {
  const auto& [left, right] = facts.images;
  for (const auto& image : {left, right}) {
    if (image && !image->fault.empty()) return failureLine(Subject::kImages, image->fault);
  }
  if (!left || !right) return unknownLine(Subject::kImages, "no images of both cameras yet");
  if (left->width != right->width || left->height != right->height) {
    return failureLine(Subject::kImages, Level::kError,
                       "left images are " + sizeText(left->width, left->height) + ", right ones " +
                           sizeText(right->width, right->height),
                       "run both cameras at the resolution of the calibration");
  }
  if (facts.camera &&
      (facts.camera->width != left->width || facts.camera->height != left->height)) {
    return failureLine(Subject::kImages, Level::kError,
                       "images are " + sizeText(left->width, left->height) +
                           ", but camera_info describes " +
                           sizeText(facts.camera->width, facts.camera->height),
                       "calibrate for this resolution, or set binning and roi in camera_info");
  }
  if (const auto line = contentsFault(facts)) return *line;
  if (!facts.damage.empty()) {
    DoctorLine line = failureLine(Subject::kImages, facts.damage);
    line.level = Level::kWarn;
    line.text = "some pairs cannot be used, the last one for this: " + line.text;
    return line;
  }
  return okLine(Subject::kImages, sizeText(left->width, left->height) + " " + left->encoding);
}

DoctorLine checkImages(const DoctorFacts& facts) {
  DoctorLine line = evaluateImages(facts);
  for (std::size_t i = 0; i < facts.images.size(); ++i) {
    if (!facts.images[i]) continue;
    const ImageFacts& image = *facts.images[i];
    line.values.emplace_back(i == 0 ? "left image" : "right image",
                             sizeText(image.width, image.height) + " " + image.encoding);
  }
  if (facts.pair && facts.pair->valid()) {
    line.values.emplace_back("brightness, right to left", number(facts.pair->brightness_ratio, 2));
    line.values.emplace_back("obscured in the left image [%]",
                             number(100.0 * facts.pair->obscured_left, 1));
    line.values.emplace_back("obscured in the right image [%]",
                             number(100.0 * facts.pair->obscured_right, 1));
  }
  return line;
}

/// P is in pixels of other images if its principal point is far from the middle of these in both
/// directions, and to the same side: 2 and 0.5 times their size put it at 1 and 0.25 of them.
bool isOfOtherResolution(const StereoCamera& camera) {
  constexpr double kLowest = 0.3;
  constexpr double kHighest = 0.7;
  const double x = camera.cx / camera.width;
  const double y = camera.cy / camera.height;
  return std::max(x, y) < kLowest || std::min(x, y) > kHighest;
}

DoctorLine evaluateCalibration(const DoctorFacts& facts) {
  if (!facts.calibration_fault.empty()) {
    return failureLine(Subject::kCalibration, facts.calibration_fault);
  }
  if (!facts.camera)
    return unknownLine(Subject::kCalibration, "no camera_info of both cameras yet");
  const StereoCamera& camera = *facts.camera;
  const std::string text =
      "fx " + number(camera.fx, 1) + ", fy " + number(camera.fy, 1) + ", cx " +
      number(camera.cx, 1) + ", cy " + number(camera.cy, 1) + " px, " +
      (facts.parameters.rectify ? "rectified here (K, D, R, P)" : "assumed to be rectified (P)");
  if (isOfOtherResolution(camera)) {
    return failureLine(
        Subject::kCalibration, Level::kWarn,
        text + ": the principal point is far from the middle of the images, " +
            sizeText(camera.width, camera.height),
        "calibrate for this resolution, or scale the calibration with the images: it "
        "is in pixels of others");
  }
  if (!facts.calibration_change.empty()) {
    return failureLine(Subject::kCalibration, Level::kWarn,
                       facts.calibration_change + " is not the same in all messages",
                       "let one driver publish camera_info, with the calibration of these images; "
                       "the odometry uses another one only once several in a row have it");
  }
  return okLine(Subject::kCalibration, text);
}

DoctorLine checkCalibration(const DoctorFacts& facts) {
  DoctorLine line = evaluateCalibration(facts);
  if (!facts.camera) return line;
  const StereoCamera& camera = *facts.camera;
  line.values = {{"fx [px]", number(camera.fx, 3)},
                 {"image width [px]", std::to_string(camera.width)},
                 {"image height [px]", std::to_string(camera.height)}};
  return line;
}

DoctorLine checkBaseline(const DoctorFacts& facts) {
  constexpr double kShortest_m = 0.005;
  constexpr double kLongest_m = 5.0;
  if (!facts.camera) return unknownLine(Subject::kBaseline, "no usable calibration yet");
  const double baseline_m = facts.camera->baseline_m;
  const std::string text = number(baseline_m, 4) + " m";
  DoctorLine line =
      baseline_m < kShortest_m || baseline_m > kLongest_m
          ? failureLine(
                Subject::kBaseline, Level::kWarn, text + ", which hardly any pair has",
                "calibrate with the size of the target's squares in metres, not millimetres; "
                "P[3] of right/camera_info must be -fx * baseline")
          : okLine(Subject::kBaseline, text);
  line.values = {{"baseline [m]", number(baseline_m, 5)}};
  return line;
}

// --- Measurements of the image pair

/// The line if there is no usable measurement; nothing if there is.
std::optional<DoctorLine> withoutMeasurement(const DoctorFacts& facts, Subject subject) {
  if (!facts.pair) return unknownLine(subject, "no pair of images measured yet");
  constexpr int kFew = PairMeasurement::kFewestMatches;
  if (facts.pair->keypoints_left < kFew || facts.pair->keypoints_right < kFew) {
    return unknownLine(subject, "not measured: too few keypoints, " +
                                    std::to_string(facts.pair->keypoints_left) + " and " +
                                    std::to_string(facts.pair->keypoints_right));
  }
  if (facts.pair->identical) return unknownLine(subject, "not measured: both images are the same");
  return std::nullopt;
}

const char* rectificationHint(const DoctorFacts& facts) {
  return facts.parameters.rectify
             ? "calibrate the pair again (camera_calibration), and check that camera_info is of "
               "these cameras and not exchanged"
             : "subscribe to rectified images (stereo_image_proc), or set rectify to true if these "
               "are raw; if they are rectified, calibrate the pair again";
}

DoctorLine evaluateRectification(const DoctorFacts& facts) {
  constexpr int kManyKeypoints = 150;  // some of these match, unless something is wrong
  if (const auto line = withoutMeasurement(facts, Subject::kRectification)) return *line;
  const PairMeasurement& pair = *facts.pair;
  if (!pair.valid() && std::min(pair.keypoints_left, pair.keypoints_right) < kManyKeypoints) {
    return unknownLine(Subject::kRectification,
                       "not measured: " + std::to_string(pair.matches) + " points match, of " +
                           std::to_string(pair.keypoints_left) + " and " +
                           std::to_string(pair.keypoints_right) + " keypoints");
  }
  if (!pair.valid()) {
    return failureLine(
        Subject::kRectification, Level::kWarn,
        "keypoints of the left image have no match in the right one, not even in distant "
        "rows (" +
            std::to_string(pair.keypoints_left) + " and " + std::to_string(pair.keypoints_right) +
            " keypoints)",
        "check that both cameras look in the same direction, at the same time, and that both "
        "are sharp and none is mounted upside down");
  }
  const std::string text = "vertical disparity of matched points is " +
                           number(pair.vertical_disparity_px, 2) + " px (median of " +
                           std::to_string(pair.matches) + ", right lower by " +
                           number(pair.row_offset_px, 2) + ")";
  if (pair.vertical_disparity_px > kMaxVerticalDisparity_px) {
    return failureLine(Subject::kRectification, Level::kWarn, "images are not rectified: " + text,
                       rectificationHint(facts));
  }
  if (facts.vertical_drift_px && std::abs(*facts.vertical_drift_px) > kMaxVerticalDrift_px) {
    return failureLine(Subject::kRectification, Level::kWarn,
                       "the vertical disparity has drifted by " +
                           number(*facts.vertical_drift_px, 2) + " px since the start: " + text,
                       "fasten the cameras and calibrate the pair again");
  }
  return okLine(Subject::kRectification, text);
}

DoctorLine checkRectification(const DoctorFacts& facts) {
  DoctorLine line = evaluateRectification(facts);
  if (facts.pair && facts.pair->valid()) {
    line.values = {
        {"vertical disparity, absolute [px]", number(facts.pair->vertical_disparity_px, 3)},
        {"vertical disparity, right minus left [px]", number(facts.pair->row_offset_px, 3)},
        {"matched points", std::to_string(facts.pair->matches)}};
    if (facts.vertical_drift_px) {
      line.values.emplace_back("drift of vertical disparity [px]",
                               number(*facts.vertical_drift_px, 3));
    }
  }
  return line;
}

DoctorLine evaluateDisparity(const DoctorFacts& facts) {
  constexpr double kExchanged = 0.7;
  constexpr double kTooMany = 0.25;
  if (const auto line = withoutMeasurement(facts, Subject::kDisparity)) return *line;
  const PairMeasurement& pair = *facts.pair;
  if (!pair.valid()) return unknownLine(Subject::kDisparity, "not measured: no points match");
  const std::string text = "median " + number(pair.disparity_px, 1) + " px";
  const std::string share = number(100.0 * pair.behind_infinity_share, 0) + " % are negative";
  if (pair.behind_infinity_share > kExchanged) {
    return failureLine(Subject::kDisparity, Level::kError,
                       text + ", " + share + ": left and right cameras are swapped",
                       "exchange the image topics (with their camera_info) or the cameras' cables; "
                       "halves of a side-by-side image: swap:=true (camera.launch, SideBySide)");
  }
  if (pair.behind_infinity_share > kTooMany) {
    return failureLine(Subject::kDisparity, Level::kWarn,
                       text + ", " + share + ": these points would be behind infinity",
                       "calibrate the pair again: the cameras' angle to each other, or cx in P, is "
                       "wrong; images must be rectified");
  }
  return okLine(Subject::kDisparity, text + ", left camera is left");
}

/// Whether the odometry, which sees more than one pair, corrects disparities by more than what
/// calibrations leave.
bool hasMoved(const DoctorFacts& facts) {
  return facts.camera && facts.correction_px &&
         facts.correction_px->x() > kMaxCorrection_rad * facts.camera->fx;
}

DoctorLine checkDisparity(const DoctorFacts& facts) {
  DoctorLine line = evaluateDisparity(facts);
  if (!line.failed() && hasMoved(facts)) {
    line = failureLine(Subject::kDisparity, Level::kWarn,
                       line.text + "; the odometry corrects disparities by " +
                           number(facts.correction_px->x(), 1) + " px",
                       "fasten the cameras and calibrate the pair again: the right one has turned "
                       "against the left one, or camera_info is of another lens");
  }
  if (facts.pair && facts.pair->valid()) {
    line.values = {
        {"disparity [px]", number(facts.pair->disparity_px, 2)},
        {"negative disparities [%]", number(100.0 * facts.pair->behind_infinity_share, 1)}};
  }
  if (facts.correction_px) {
    line.values.emplace_back("correction of disparities [px]", number(facts.correction_px->x(), 3));
    line.values.emplace_back("correction of rows [px]", number(facts.correction_px->y(), 3));
  }
  return line;
}

}  // namespace

std::vector<DoctorLine> checkCamera(const DoctorFacts& facts) {
  return {checkImages(facts), checkCalibration(facts), checkBaseline(facts),
          checkRectification(facts), checkDisparity(facts)};
}

}  // namespace point_line_odometry
