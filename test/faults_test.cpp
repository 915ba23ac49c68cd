/// The core under the faults that a robot meets: what it says of each, and that the pose it
/// publishes stays continuous. Faults of messages are tested by nodelet_faults_test.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <iostream>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "failing_allocator.h"
#include "knocked_camera.h"
#include "odometry/uncertainty.h"
#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_odometry.h"
#include "point_line_odometry/types.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using synthetic::drive;
using synthetic::kPeriodNs;
using synthetic::noisy;
using synthetic::room;
using synthetic::stamped;
using synthetic::transform;

constexpr double kPeriod_s = 1e-9 * kPeriodNs;
const StereoCamera kCamera = synthetic::roomCamera();

std::int64_t stampOf(int k) { return (k + 1) * kPeriodNs; }

StereoImages uniform(int brightness, int k) {
  const cv::Mat image(kCamera.height, kCamera.width, CV_8UC1, cv::Scalar(brightness));
  return {image, image, stampOf(k)};
}

bool allFinite(const FrameResult& result) {
  return result.T_odom_camera.matrix().allFinite() && result.pose_covariance.allFinite() &&
         result.twist.allFinite() && result.twist_covariance.allFinite() &&
         std::isfinite(result.rms_px);
}

double distance(const Isometry3d& a, const Isometry3d& b) {
  return (a.translation() - b.translation()).norm();
}

double angle(const Isometry3d& a, const Isometry3d& b) {
  return logSO3(a.linear().transpose() * b.linear()).norm();
}

/// What a step of the pose has that the velocity does not explain [m], [rad].
struct Jump {
  double translation_m;
  double rotation_rad;
};

Jump jump(const FrameResult& prev, const FrameResult& curr) {
  const double dt_s = 1e-9 * static_cast<double>(curr.stamp_ns - prev.stamp_ns);
  const Isometry3d expected = prev.T_odom_camera * motionAtVelocity(curr.twist, dt_s);
  return {distance(expected, curr.T_odom_camera), angle(expected, curr.T_odom_camera)};
}

// --- Frames that show nothing

struct BlindCase {
  const char* name;
  std::function<StereoImages(int)> image;
};

StereoImages blurred(int k) {
  StereoImages images = drive(k);
  for (cv::Mat* image : {&images.left, &images.right}) {
    cv::GaussianBlur(image->clone(), *image, {}, 30.0);
  }
  return images;
}

StereoImages noise(int k) {
  StereoImages images = uniform(0, k);
  cv::RNG random(static_cast<std::uint64_t>(k));
  for (cv::Mat* image : {&images.left, &images.right}) {
    *image = image->clone();
    random.fill(*image, cv::RNG::UNIFORM, 0, 256);
  }
  return images;
}

/// The lens of one camera is covered.
StereoImages oneEyed(int k) {
  StereoImages images = drive(k);
  images.right = uniform(0, k).right;
  return images;
}

class BlindTest : public ::testing::TestWithParam<BlindCase> {};

/// DEGRADED for as long as a velocity is worth something, then LOST, and on without a jump when
/// there is something to be seen again; the camera has moved on meanwhile.
TEST_P(BlindTest, DegradesThenIsLostThenGoesOnWithoutAJump) {
  constexpr int kDark = 6;
  constexpr int kLight = 14;
  constexpr int kEnd = 24;
  StereoOdometry odometry(kCamera, synthetic::roomParameters());
  FrameResult last;
  FrameResult first_in_light;
  for (int k = 0; k < kEnd; ++k) {
    const bool dark = k >= kDark && k < kLight;
    const FrameResult result = odometry.process(dark ? GetParam().image(k) : drive(k));
    ASSERT_TRUE(allFinite(result)) << k;
    if (dark) {
      const bool predicted = k < kDark + 5;  // tracking/max_prediction_s: 0.5
      EXPECT_EQ(result.state, predicted ? TrackingState::kDegraded : TrackingState::kLost) << k;
      EXPECT_NE(result.reason, TrackingReason::kNone);
      EXPECT_GT(result.pose_covariance.trace(), last.pose_covariance.trace()) << k;
      EXPECT_NEAR(distance(last.T_odom_camera, result.T_odom_camera), predicted ? 0.12 : 0.0, 0.02);
    }
    if (k > 0) {
      EXPECT_LT(jump(last, result).translation_m, 0.06) << k;
      EXPECT_LT(jump(last, result).rotation_rad, 0.015) << k;
    }
    if (k == kLight) first_in_light = result;
    last = result;
  }
  EXPECT_EQ(last.state, TrackingState::kOk);
  EXPECT_LT(distance(first_in_light.T_odom_camera.inverse() * last.T_odom_camera,
                     synthetic::truePose(kLight).inverse() * synthetic::truePose(kEnd - 1)),
            0.6)
      << "it goes on measuring";
}

INSTANTIATE_TEST_SUITE_P(
    Faults, BlindTest,
    ::testing::Values(BlindCase{"black", [](int k) { return uniform(0, k); }},
                      BlindCase{"saturated", [](int k) { return uniform(255, k); }},
                      BlindCase{"uniform", [](int k) { return uniform(128, k); }},
                      BlindCase{"blurred", blurred}, BlindCase{"noise", noise},
                      BlindCase{"one_eyed", oneEyed}),
    [](const auto& info) { return std::string(info.param.name); });

/// What was wrongly predicted fades out: the camera has stopped in the dark.
TEST(Faults, AWrongPredictionFadesOut) {
  StereoOdometry odometry(kCamera, synthetic::roomParameters());
  FrameResult last;
  for (int k = 0; k < 4; ++k) last = odometry.process(drive(k));
  for (int k = 4; k < 8; ++k) last = odometry.process(uniform(0, k));
  const Isometry3d ground_truth = synthetic::truePose(4);
  const double wrong_m = distance(last.T_odom_camera, ground_truth);
  ASSERT_GT(wrong_m, 0.3);
  for (int k = 8; k < 80; ++k) {
    const FrameResult result = odometry.process(stamped(drive(4), stampOf(k)));
    ASSERT_EQ(result.state, TrackingState::kOk) << toString(result.reason);
    EXPECT_LT(jump(last, result).translation_m, 0.02) << k;
    const Vector3d error = result.T_odom_camera.translation() - ground_truth.translation();
    const Eigen::Matrix3d covariance = result.pose_covariance.topLeftCorner<3, 3>();
    EXPECT_LT(error.dot(covariance.ldlt().solve(error)), 16.0) << "the covariance knows of it";
    last = result;
  }
  EXPECT_LT(distance(last.T_odom_camera, ground_truth), 0.02);
  EXPECT_LT(angle(last.T_odom_camera, ground_truth), 0.004);
}

/// The same with gaps before it has faded: what had so much time is not taken up at once.
TEST(Faults, AGapIsNoLeaveToJump) {
  StereoOdometry odometry(kCamera, synthetic::roomParameters());
  for (int k = 0; k < 4; ++k) odometry.process(drive(k));
  for (int k = 4; k < 8; ++k) odometry.process(uniform(0, k));
  FrameResult before;
  for (int k = 8; k < 10; ++k) before = odometry.process(stamped(drive(4), stampOf(k)));
  ASSERT_GT(distance(before.T_odom_camera, synthetic::truePose(4)), 0.3);
  const FrameResult after = odometry.process(stamped(drive(4), stampOf(40)));
  EXPECT_EQ(after.state, TrackingState::kOk) << "it is found in the map";
  EXPECT_LT(distance(after.T_odom_camera, before.T_odom_camera), 0.06);
  const FrameResult unknown = odometry.process(blurred(80));
  EXPECT_EQ(unknown.reason, TrackingReason::kFrameGap);
  EXPECT_LT(distance(unknown.T_odom_camera, after.T_odom_camera), 0.06);
}

// --- Cameras that expose each image anew

struct ExposureCase {
  const char* name;
  std::function<double(int)> left;  // gain of frame k
  std::function<double(int)> right;
};

StereoImages exposed(int k, const ExposureCase& camera) {
  StereoImages images = drive(k);
  images.left *= camera.left(k);
  images.right *= camera.right(k);
  return images;
}

/// Of the drive through the room [m], [rad].
struct MotionErrors {
  double translation_rms_m = 0.0;
  double rotation_rms_rad = 0.0;
};

MotionErrors errorsOf(const ExposureCase& camera) {
  constexpr int kEnd = 24;
  StereoOdometry odometry(kCamera, synthetic::roomParameters());
  MotionErrors squares;
  Isometry3d before;
  for (int k = 0; k < kEnd; ++k) {
    const FrameResult result = odometry.process(exposed(k, camera));
    EXPECT_EQ(result.state, k == 0 ? TrackingState::kInitializing : TrackingState::kOk) << k;
    if (k > 0) {
      const Isometry3d moved = before.inverse() * result.T_odom_camera;
      const Isometry3d ground_truth = synthetic::truePose(k - 1).inverse() * synthetic::truePose(k);
      squares.translation_rms_m += std::pow(distance(moved, ground_truth), 2) / (kEnd - 1);
      squares.rotation_rms_rad += std::pow(angle(moved, ground_truth), 2) / (kEnd - 1);
    }
    before = result.T_odom_camera;
  }
  return {std::sqrt(squares.translation_rms_m), std::sqrt(squares.rotation_rms_rad)};
}

double constantly(int /*k*/) { return 1.0; }
double alternating(int k) { return k % 2 == 0 ? 0.9 : 0.6; }
double intoATunnel(int k) { return k < 8 ? 1.0 : std::max(0.3, 1.0 - 0.15 * (k - 7)); }

class ExposureTest : public ::testing::TestWithParam<ExposureCase> {};

TEST_P(ExposureTest, CostsLittle) {
  const MotionErrors errors = errorsOf(GetParam());
  const MotionErrors without = errorsOf({"", constantly, constantly});
  std::cout << "translation " << without.translation_rms_m << " -> " << errors.translation_rms_m
            << " m, rotation " << without.rotation_rms_rad << " -> " << errors.rotation_rms_rad
            << " rad\n";
  EXPECT_LT(errors.translation_rms_m, 1.5 * without.translation_rms_m);
  EXPECT_LT(errors.rotation_rms_rad, 1.5 * without.rotation_rms_rad);
}

INSTANTIATE_TEST_SUITE_P(Faults, ExposureTest,
                         ::testing::Values(ExposureCase{"alternating", alternating, alternating},
                                           ExposureCase{"into_a_tunnel", intoATunnel, intoATunnel},
                                           ExposureCase{"right_darker", constantly,
                                                        [](int) { return 0.6; }},
                                           ExposureCase{"each_by_itself", alternating, constantly}),
                         [](const auto& info) { return std::string(info.param.name); });

// --- Frames that are missing

struct GapCase {
  const char* name;
  double turn_before_rad;  // between frames, before the gap
  double turn_in_gap_rad;  // over all of it
};

class DroppedFramesTest : public ::testing::TestWithParam<GapCase> {};

/// Five periods pass between two frames. What turns steadily is found by the prediction scaled by
/// the time, what begins to turn meanwhile by the wider search.
TEST_P(DroppedFramesTest, IsBridged) {
  const GapCase& fault = GetParam();
  const auto turned = [](double angle_rad) { return transform({0, angle_rad, 0}, {0, 0, 0}); };
  const auto view = [&](double angle_rad, int k) {
    return room(fault.name + std::to_string(angle_rad), turned(angle_rad), k);
  };
  StereoOdometry odometry(kCamera, synthetic::roomParameters());
  const double start_rad = -3 * fault.turn_before_rad - 0.5 * fault.turn_in_gap_rad;
  double angle_rad = start_rad;
  for (int k = 0; k < 4; ++k, angle_rad += fault.turn_before_rad) {
    const FrameResult result = odometry.process(view(angle_rad, k));
    ASSERT_NE(result.state, TrackingState::kDegraded) << k << toString(result.reason);
  }
  angle_rad += fault.turn_in_gap_rad - fault.turn_before_rad;
  const FrameResult result = odometry.process(view(angle_rad, 8));
  EXPECT_EQ(result.state, TrackingState::kOk) << toString(result.reason);
  EXPECT_LT(angle(result.T_odom_camera, turned(angle_rad - start_rad)), 0.005);
  EXPECT_LT(result.T_odom_camera.translation().norm(), 0.03);
}

INSTANTIATE_TEST_SUITE_P(Faults, DroppedFramesTest,
                         ::testing::Values(GapCase{"steady", 0.1, 0.5},
                                           GapCase{"begins", 0.0, 0.2}),
                         [](const auto& info) { return std::string(info.param.name); });

/// The motion over more than tracking/max_frame_gap_s is measured, too, where the images show it:
/// 1.4 m and 8 degrees further on too few landmarks are found to recognize the place by them.
TEST(Faults, AGapIsBridged) {
  for (const bool dark : {false, true}) {
    StereoOdometry odometry(kCamera, synthetic::roomParameters());
    for (int k = 0; k < 4; ++k) odometry.process(drive(k));
    for (int k = 4; k < 15 && dark; ++k) odometry.process(uniform(0, k));
    const FrameResult found = odometry.process(drive(15));
    EXPECT_EQ(found.state, TrackingState::kOk) << toString(found.reason);
    EXPECT_EQ(found.counts.relocalizations, dark ? 1 : 0);
    EXPECT_LT(distance(found.T_odom_estimate, synthetic::truePose(15)), 0.02);
    EXPECT_LT(angle(found.T_odom_estimate, synthetic::truePose(15)), 0.005);
    const FrameResult next = odometry.process(drive(16));
    EXPECT_EQ(next.state, TrackingState::kOk) << toString(next.reason);
    EXPECT_LT(jump(found, next).translation_m, 0.06);
    EXPECT_LT(distance(next.T_odom_estimate, synthetic::truePose(16)), 0.02);
  }
}

/// Of a stream that comes back the first images may show nothing.
TEST(Faults, ABlackImageAfterAGapIsNotTracked) {
  StereoOdometry odometry(kCamera, synthetic::roomParameters());
  for (int k = 0; k < 4; ++k) odometry.process(drive(k));
  EXPECT_EQ(odometry.process(uniform(0, 14)).reason, TrackingReason::kFrameGap);
  const FrameResult found = odometry.process(drive(15));
  EXPECT_EQ(found.state, TrackingState::kOk) << toString(found.reason);
  EXPECT_LT(distance(found.T_odom_estimate, synthetic::truePose(15)), 0.02);
}

/// Without landmarks it may be another place that looks alike: not where half of the features are
/// found, as by a camera that has not moved.
TEST(Faults, AMotionOverAGapIsDoubtedWithoutLandmarks) {
  Parameters parameters = synthetic::roomParameters();
  parameters.window.size = 0;
  for (const int shown : {3, 15}) {
    StereoOdometry odometry(kCamera, parameters);
    for (int k = 0; k < 4; ++k) odometry.process(drive(k));
    const FrameResult result = odometry.process(stamped(drive(shown), stampOf(15)));
    EXPECT_LT(distance(result.T_odom_estimate, synthetic::truePose(shown)), 0.02);
    if (shown == 3) {
      EXPECT_EQ(result.state, TrackingState::kOk) << toString(result.reason);
      EXPECT_LT(result.estimate_covariance.trace(), 0.01);
    } else {
      EXPECT_EQ(result.state, TrackingState::kDegraded);
      EXPECT_EQ(result.reason, TrackingReason::kAmbiguousMotion);
      EXPECT_GT(result.estimate_covariance.trace(), 1.0);
    }
    const FrameResult next = odometry.process(stamped(drive(shown + 1), stampOf(16)));
    EXPECT_EQ(next.state, TrackingState::kOk) << toString(next.reason);
    EXPECT_LT(jump(result, next).translation_m, 0.13);
  }
}

/// A place that is not seen from where the camera was.
StereoImages elsewhere(int k) {
  StereoImages images = drive(k);
  for (cv::Mat* image : {&images.left, &images.right}) cv::flip(image->clone(), *image, 0);
  return images;
}

/// However long a prediction may last.
TEST(Faults, AGapToAnotherPlaceKeepsThePose) {
  for (const double max_prediction_s : {0.5, 10.0}) {
    Parameters parameters = synthetic::roomParameters();
    parameters.tracking.max_prediction_s = max_prediction_s;
    StereoOdometry odometry(kCamera, parameters);
    FrameResult before;
    for (int k = 0; k < 4; ++k) before = odometry.process(drive(k));
    const FrameResult gap = odometry.process(elsewhere(15));
    EXPECT_EQ(gap.reason, TrackingReason::kFrameGap);
    EXPECT_EQ(gap.state, TrackingState::kLost);
    EXPECT_EQ(gap.T_odom_camera.matrix(), before.T_odom_camera.matrix());
    EXPECT_GT(gap.pose_covariance.trace(), 10.0 * before.pose_covariance.trace());
    const FrameResult next = odometry.process(elsewhere(16));
    EXPECT_EQ(next.state, TrackingState::kOk) << toString(next.reason);
    EXPECT_LT(jump(gap, next).translation_m, 0.01);
    EXPECT_GT(next.pose_covariance.trace(), 10.0 * before.pose_covariance.trace());
  }
}

// --- Motions that cannot be

/// Everything is rejected, so the state goes the same way as in the dark.
TEST(Faults, FasterThanAnythingIsRejected) {
  Parameters parameters = synthetic::roomParameters();
  StereoOdometry odometry(kCamera, parameters);
  FrameResult last;
  for (int k = 0; k < 4; ++k) last = odometry.process(drive(k));
  parameters.tracking.max_speed_m_s = 1.0;  // the camera moves at 1.2
  odometry.setParameters(parameters);
  odometry.process(drive(4));
  for (int k = 5; k < 12; ++k) {
    const FrameResult result = odometry.process(drive(k));
    EXPECT_EQ(result.reason, TrackingReason::kTooFast) << k;
    EXPECT_NE(result.state, TrackingState::kOk);
    EXPECT_LT(jump(last, result).translation_m, 0.15) << "never what was measured";
    last = result;
  }
}

// --- A right camera that was knocked

/// From the first motion on.
TEST(KnockedCamera, IsCorrectedByItsVerticalDisparities) {
  for (const Vector3d& rotation_deg : {Vector3d(0.0, 0.0, 0.0), Vector3d(0.0, 0.0, 0.2),
                                       Vector3d(0.1, 0.0, 0.0), Vector3d(0.0, 0.0, -0.8)}) {
    StereoOdometry odometry(kCamera, synthetic::roomParameters());
    for (int k = 0; k < 30; ++k) {
      const FrameResult result = odometry.process(knocked(drive(k), kCamera, rotation_deg));
      if (k > 0) {
        EXPECT_EQ(result.state, TrackingState::kOk) << k;
      }
      const double error_m = distance(result.T_odom_camera, synthetic::truePose(k));
      const double error_rad = angle(result.T_odom_camera, synthetic::truePose(k));
      EXPECT_LT(error_m, 0.015) << rotation_deg.transpose() << ", frame " << k;
      EXPECT_LT(error_rad, 3e-3) << rotation_deg.transpose() << ", frame " << k;
    }
  }
}

/// Root mean squares over starts all along the drive: a single first motion is good or bad by
/// chance.
TEST(KnockedCamera, FirstMotionsAreExact) {
  constexpr int kStarts = 20;
  for (const Vector3d& rotation_deg : {Vector3d(0.0, 0.0, 0.0), Vector3d(0.0, 0.0, 0.2),
                                       Vector3d(0.1, 0.0, 0.0), Vector3d(0.0, 0.0, -0.8)}) {
    double squared_m = 0.0;
    double squared_rad = 0.0;
    for (int first = 0; first < 2 * kStarts; first += 2) {
      StereoOdometry odometry(kCamera, synthetic::roomParameters());
      odometry.process(knocked(drive(first), kCamera, rotation_deg));
      const FrameResult result = odometry.process(knocked(drive(first + 1), kCamera, rotation_deg));
      EXPECT_EQ(result.state, TrackingState::kOk) << first;
      const Isometry3d truth =
          synthetic::truePose(first).inverse() * synthetic::truePose(first + 1);
      const double error_m = distance(result.T_odom_camera, truth);
      const double error_rad = angle(result.T_odom_camera, truth);
      EXPECT_LT(error_m, 0.01) << rotation_deg.transpose() << ", from frame " << first;
      EXPECT_LT(error_rad, 2e-3) << rotation_deg.transpose() << ", from frame " << first;
      squared_m += error_m * error_m / kStarts;
      squared_rad += error_rad * error_rad / kStarts;
    }
    // Measured 0.9, 1.3, 1.6 and 2.1 mm; 1.4, 2.4, 2.2 and 2.7 by patches warped once.
    const bool far_off = rotation_deg.norm() > 0.5;
    EXPECT_LT(std::sqrt(squared_m), far_off ? 0.0025 : 0.0018) << rotation_deg.transpose();
    EXPECT_LT(std::sqrt(squared_rad), far_off ? 6e-4 : 3.4e-4) << rotation_deg.transpose();
  }
}

/// Also between the first motions, where one waits for the next and the map starts anew.
TEST(KnockedCamera, ContinuesFromASavedState) {
  const auto images = [](int k) { return knocked(drive(k), kCamera, Vector3d(0.2, 0.4, -0.3)); };
  StereoOdometry odometry(kCamera, synthetic::roomParameters());
  StereoOdometry restored(kCamera, synthetic::roomParameters());
  for (int k = 0; k < 12; ++k) {
    restored.restoreState(odometry.saveState());
    const FrameResult expected = odometry.process(images(k));
    const FrameResult result = restored.process(images(k));
    EXPECT_EQ(result.state, expected.state) << k;
    EXPECT_EQ(result.T_odom_camera.matrix(), expected.T_odom_camera.matrix()) << k;
    EXPECT_EQ(restored.correction().u, odometry.correction().u) << k;
  }
  EXPECT_GT(odometry.correction().u.cwiseAbs().maxCoeff(), 0.5);
}

// --- Images that come again

struct RepetitionCase {
  const char* name;
  bool left;
  bool right;
};

class RepeatedImagesTest : public ::testing::TestWithParam<RepetitionCase> {
 protected:
  /// Frame k of the drive, in every third frame with images of the frame before.
  static bool isRepeated(int k) { return k > 3 && k % 3 == 2; }
  static StereoImages images(int k) {
    StereoImages now = drive(k);
    if (!isRepeated(k)) return now;
    if (GetParam().left) now.left = drive(k - 1).left;
    if (GetParam().right) now.right = drive(k - 1).right;
    return now;
  }
};

TEST_P(RepeatedImagesTest, AreNotMeasured) {
  StereoOdometry odometry(kCamera, synthetic::roomParameters());
  FrameResult last;
  for (int k = 0; k < 21; ++k) {
    const FrameResult result = odometry.process(images(k));
    ASSERT_TRUE(allFinite(result)) << k;
    EXPECT_EQ(result.reason == TrackingReason::kRepeatedImages, isRepeated(k)) << k;
    if (k > 0) {
      EXPECT_EQ(result.state, isRepeated(k) ? TrackingState::kDegraded : TrackingState::kOk) << k;
      EXPECT_LT(jump(last, result).translation_m, 0.02) << k;
    }
    EXPECT_LT(distance(result.T_odom_camera, synthetic::truePose(k)), 0.03) << k;
    last = result;
  }
}

INSTANTIATE_TEST_SUITE_P(Faults, RepeatedImagesTest,
                         ::testing::Values(RepetitionCase{"of_both", true, true},
                                           RepetitionCase{"of_the_left", true, false},
                                           RepetitionCase{"of_the_right", false, true}),
                         [](const auto& info) { return std::string(info.param.name); });

/// A camera hangs that has been seen to have noise while it stood: at any speed and for any time.
TEST(RepeatedImages, OfACameraWithNoiseAreNeverMeasured) {
  constexpr int kStart = 30;  // of the drive
  constexpr int kHangs = 40;
  StereoOdometry odometry(kCamera, synthetic::roomParameters());
  for (int k = 0; k < 60; ++k) {
    const int shown = std::min(k, kHangs);
    const int place = std::max(0, shown - kStart);
    StereoImages images = noisy(stamped(drive(place), stampOf(shown)), 2.0);
    images.stamp_ns = stampOf(k);
    const FrameResult result = odometry.process(images);
    ASSERT_EQ(result.reason == TrackingReason::kRepeatedImages, k > kHangs) << k;
    if (k > kHangs + 5) {
      EXPECT_EQ(result.state, TrackingState::kLost) << k;  // tracking/max_prediction_s
    }
  }
}

/// Its driver goes on after a gap with the old buffer.
TEST(RepeatedImages, OfACameraWithNoiseAreNotMeasuredAfterAGap) {
  StereoOdometry odometry(kCamera, synthetic::roomParameters());
  StereoImages images;
  for (int k = 0; k < 30; ++k) {
    images = noisy(stamped(drive(0), stampOf(k)), 2.0);
    odometry.process(images);
  }
  images.stamp_ns = stampOf(50);
  const FrameResult result = odometry.process(images);
  EXPECT_EQ(result.reason, TrackingReason::kRepeatedImages);
  EXPECT_EQ(result.state, TrackingState::kLost);
}

/// One camera hangs while the other goes on, without any noise known.
TEST(RepeatedImages, OfOneCameraAreNotMeasuredHoweverLong) {
  StereoOdometry odometry(kCamera, synthetic::roomParameters());
  for (int k = 0; k < 30; ++k) {
    StereoImages images = noisy(drive(k), 2.0);
    if (k > 6) images.left = noisy(drive(6), 2.0).left;
    const FrameResult result = odometry.process(images);
    EXPECT_EQ(result.reason == TrackingReason::kRepeatedImages, k > 6) << k;
  }
}

/// Another exposure at rest is no noise: a simulated camera goes on to be believed.
TEST(RepeatedImages, OfASimulatedCameraAreBelievedAfterAnotherExposure) {
  StereoOdometry odometry(kCamera, synthetic::roomParameters());
  for (int k = 0; k < 60; ++k) {
    const double gain = 1.0 - 0.01 * std::clamp(k - 15, 0, 20);
    StereoImages images = stamped(drive(0), stampOf(k));
    for (cv::Mat* image : {&images.left, &images.right}) {
      cv::Mat dimmed;  // the images of drive() are shared
      image->convertTo(dimmed, -1, gain);
      *image = dimmed;
    }
    const FrameResult result = odometry.process(images);
    EXPECT_EQ(result.state, k == 0 ? TrackingState::kInitializing : TrackingState::kOk) << k;
  }
}

/// Something moves in one view of a simulated camera without noise, or a codec leaves out what does
/// not change.
TEST(RepeatedImages, OfOneCameraAtRestAreBelievedIfTheOtherHardlyChanges) {
  StereoOdometry odometry(kCamera, synthetic::roomParameters());
  for (int k = 0; k < 20; ++k) {
    StereoImages images = stamped(drive(0), stampOf(k));
    images.left = images.left.clone();
    cv::circle(images.left, {40 + 10 * k, 60}, 15, cv::Scalar(200), cv::FILLED);
    const FrameResult result = odometry.process(images);
    EXPECT_EQ(result.state, k == 0 ? TrackingState::kInitializing : TrackingState::kOk) << k;
    EXPECT_LT(result.T_odom_camera.translation().norm(), 0.005) << k;
  }
}

/// After a gap the camera is looked for in the map, whether it has moved or not.
TEST(RepeatedImages, AreTrackedAfterAGap) {
  StereoOdometry odometry(kCamera, synthetic::roomParameters());
  for (int k = 0; k < 6; ++k) odometry.process(drive(k));
  const FrameResult result = odometry.process(stamped(drive(5), stampOf(30)));
  EXPECT_NE(result.reason, TrackingReason::kRepeatedImages);
  EXPECT_LT(distance(result.T_odom_estimate, synthetic::truePose(5)), 0.02);
}

/// A driver that gives each pair twice.
TEST(RepeatedImages, HalfOfTheFramesSuffice) {
  StereoOdometry odometry(kCamera, synthetic::roomParameters());
  for (int k = 0; k < 20; ++k) {
    const int shown = k - k % 2;
    const FrameResult result = odometry.process(stamped(drive(shown), stampOf(k)));
    if (k < 3) continue;  // without a velocity nothing tells that it moves
    EXPECT_EQ(result.reason == TrackingReason::kRepeatedImages, k != shown) << k;
    EXPECT_EQ(result.state, k == shown ? TrackingState::kOk : TrackingState::kDegraded) << k;
    if (k < 12) continue;  // and that of the first two is wrong
    EXPECT_LT(distance(result.T_odom_camera, synthetic::truePose(k)), 0.03) << k;
  }
}

/// From 1.2 m/s to a standstill within a frame, as a simulated robot without noise and inertia.
TEST(RepeatedImages, AreBelievedAfterAFewFrames) {
  const Parameters every_frame = synthetic::roomParameters();
  Parameters every_second = every_frame;
  every_second.tracking.landmark_frames = 1;
  for (const auto& [parameters, last] : {std::pair(every_frame, 6), std::pair(every_second, 7)}) {
    StereoOdometry odometry(kCamera, parameters);
    for (int k = 0; k < 40; ++k) {
      const FrameResult result = odometry.process(stamped(drive(std::min(k, last)), stampOf(k)));
      EXPECT_EQ(result.reason == TrackingReason::kRepeatedImages, k == last + 1 || k == last + 2)
          << k;
      if (k < last + 3) continue;
      EXPECT_EQ(result.state, TrackingState::kOk) << k;
      EXPECT_LT(distance(result.T_odom_estimate, synthetic::truePose(last)), 0.02) << k;
      EXPECT_LT(distance(result.T_odom_camera, synthetic::truePose(last)), 0.26) << k;
      if (k > 33) {
        EXPECT_LT(distance(result.T_odom_camera, synthetic::truePose(last)), 0.02) << k;
      }
    }
  }
}

// --- Stamps that tell when an image arrived

struct StampCase {
  const char* name;
  std::function<double(int)> stamp_s;
};

class ArrivalStampsTest : public ::testing::TestWithParam<StampCase> {};

/// The camera is as steady as ever: poses are those of the images, and the twist remains one of a
/// robot's.
TEST_P(ArrivalStampsTest, AreNoMotion) {
  StereoOdometry odometry(kCamera, synthetic::roomParameters());
  for (int k = 0; k < 30; ++k) {
    const auto stamp_ns = static_cast<std::int64_t>(1e9 * (1.0 + GetParam().stamp_s(k)));
    const FrameResult result = odometry.process(stamped(drive(k), stamp_ns));
    ASSERT_TRUE(allFinite(result)) << k;
    EXPECT_EQ(result.stamp_ns, stamp_ns);
    if (k == 0) continue;
    EXPECT_EQ(result.state, TrackingState::kOk) << k << " " << toString(result.reason);
    EXPECT_LT(distance(result.T_odom_camera, synthetic::truePose(k)), 0.03) << k;
    EXPECT_LT(result.twist.head<3>().norm(), 3.0) << k << ": it drives at 1.2 m/s";
  }
}

INSTANTIATE_TEST_SUITE_P(
    Faults, ArrivalStampsTest,
    ::testing::Values(StampCase{"every_fifth_is_late",
                                [](int k) { return kPeriod_s * (k % 5 == 4 ? k + 0.9 : k); }},
                      StampCase{"every_fifth_with_the_one_before",
                                [](int k) {
                                  return k % 5 == 4 ? kPeriod_s * (k - 1) + 0.001 : kPeriod_s * k;
                                }},
                      StampCase{"in_pairs",
                                [](int k) {
                                  return k > 4 && k % 2 == 0 ? kPeriod_s * (k - 1) + 0.001
                                                             : kPeriod_s * k;
                                }}),
    [](const auto& info) { return std::string(info.param.name); });

// --- What the images do not tell

/// A wall across the view, with the brightness of `shade(x, y)` [m].
StereoImages wall(double depth_m, double right_m,
                  const std::function<double(double, double)>& shade, int k) {
  constexpr int kRays = 5;  // per side of a pixel
  StereoImages images = uniform(0, k);
  for (const bool left : {true, false}) {
    cv::Mat image(kCamera.height, kCamera.width, CV_8UC1);
    const double x0 = right_m + (left ? 0.0 : kCamera.baseline_m);
    for (int v = 0; v < image.rows; ++v) {
      for (int u = 0; u < image.cols; ++u) {
        double sum = 0.0;
        for (int ray = 0; ray < kRays * kRays; ++ray) {
          const double x = u - 0.5 + (ray % kRays + 0.5) / kRays;
          const double y = v - 0.5 + (ray / kRays + 0.5) / kRays;
          sum += shade(x0 + depth_m * (x - kCamera.cx) / kCamera.fx,
                       depth_m * (y - kCamera.cy) / kCamera.fy);
        }
        image.at<uchar>(v, u) = cv::saturate_cast<uchar>(sum / (kRays * kRays));
      }
    }
    (left ? images.left : images.right) = image;
  }
  return images;
}

double tiles(double tile_m, double x, double y) {
  return synthetic::tileBrightness(1, static_cast<int>(std::floor(x / tile_m)),
                                   static_cast<int>(std::floor(y / tile_m)));
}

/// The last frame of a camera that moves to the right along a wall.
FrameResult seeWall(double depth_m, const std::function<double(double, double)>& shade) {
  Parameters parameters = synthetic::roomParameters();
  parameters.matching.search_radius_without_velocity_px = 15.0;  // stripes look alike
  StereoOdometry odometry(kCamera, parameters);
  FrameResult result;
  for (int k = 0; k < 4; ++k) {
    result = odometry.process(wall(depth_m, 0.02 * k, shade, k));
    EXPECT_TRUE(allFinite(result)) << k;
  }
  return result;
}

/// Vertical lines do not show y: that is the prediction's, and the state says so.
TEST(Faults, OneDirectionOfLinesLeavesItsAxisWeak) {
  const FrameResult result = seeWall(5.0, [](double x, double) { return tiles(0.3, x, 0.0); });
  EXPECT_EQ(result.state, TrackingState::kDegraded);
  EXPECT_EQ(result.reason, TrackingReason::kWeakMotion);
  const Matrix6d& covariance = result.twist_covariance;
  EXPECT_GT(covariance(1, 1), 1e4 * covariance(0, 0));
}

/// Of tiles some are matched with the wrong ones of the right image, and seem to be much nearer: a
/// turn, which moves near and far alike, would suit all of them.
TEST(Faults, AFewWrongDepthsDoNotMakeATranslationATurn) {
  constexpr double kDown_m = 0.03;
  StereoOdometry odometry(kCamera, synthetic::roomParameters());
  for (int k = 0; k < 5; ++k) {
    const auto shade = [k](double x, double y) { return tiles(0.3, x, y + kDown_m * k); };
    const FrameResult result = odometry.process(wall(5.0, 0.0, shade, k));
    if (k == 0) continue;
    EXPECT_EQ(result.state, TrackingState::kOk) << k;
    EXPECT_NEAR(result.twist[1], kDown_m / kPeriod_s, 0.15 * kDown_m / kPeriod_s) << k;
    EXPECT_LT(result.twist.tail<3>().norm(), 0.01) << k;  // [rad/s]; the turn would be 0.054
  }
}

/// A camera that moved downwards when tracking was lost, and then sees vertical lines only, is
/// expected to move on, but not for ever.
TEST(Faults, WeakAxesFollowTheVelocityOfBeforeALoss) {
  constexpr int kDark = 6;
  constexpr double kDepth_m = 5.0;
  constexpr double kDown_m = 0.03;
  Parameters parameters = synthetic::roomParameters();
  parameters.matching.search_radius_without_velocity_px = 15.0;  // stripes look alike
  const auto after = [&](int dark_frames) {
    StereoOdometry odometry(kCamera, parameters);
    FrameResult result;
    for (int k = 0; k < kDark + dark_frames + 3; ++k) {
      const auto shade = [&, k](double x, double y) {
        return tiles(0.3, x, k < kDark ? y + kDown_m * k : 0.0);
      };
      const bool dark = k >= kDark && k < kDark + dark_frames;
      result = odometry.process(dark ? uniform(0, k) : wall(kDepth_m, 0.0, shade, k));
      EXPECT_TRUE(allFinite(result)) << k;
      if (dark && k > kDark + 5) {
        EXPECT_EQ(result.state, TrackingState::kLost) << k;
      }
    }
    EXPECT_EQ(result.reason, TrackingReason::kWeakMotion);
    return result;
  };
  const FrameResult soon = after(8);
  EXPECT_NEAR(soon.twist[1], kDown_m / kPeriod_s, 0.1 * kDown_m / kPeriod_s);
  EXPECT_GT(std::sqrt(soon.twist_covariance(1, 1)), 1.0) << "a velocity of a second ago";
  const FrameResult late = after(300);
  EXPECT_GT(late.twist_covariance(1, 1), 100.0 * soon.twist_covariance(1, 1));
  EXPECT_LT(std::sqrt(late.twist_covariance(1, 1)), parameters.tracking.max_speed_m_s);
}

TEST(Faults, FarPointsLeaveTheTranslationWeak) {
  const auto deviation = [](double depth_m) {
    const auto shade = [&](double x, double y) { return tiles(0.06 * depth_m, x, y); };
    const FrameResult result = seeWall(depth_m, shade);
    EXPECT_EQ(result.state, TrackingState::kOk) << toString(result.reason);
    const Matrix6d& covariance = result.twist_covariance;
    return Eigen::Vector2d(std::sqrt(covariance.topLeftCorner<3, 3>().trace()),
                           std::sqrt(covariance(3, 3)));
  };
  const Eigen::Vector2d near = deviation(4.0);
  const Eigen::Vector2d far = deviation(40.0);
  EXPECT_GT(far[0], 5.0 * near[0]);
  EXPECT_LT(far[1], 3.0 * near[1]) << "turns are seen from far as well";
}

/// Seventy percent of the view are taken by something that begins to move to the right: also where
/// it is so large that most of what was in view before is found there.
TEST(Faults, MostOfTheViewMoves) {
  for (const Parameters& parameters : {synthetic::roomParameters(), Parameters()}) {
    StereoOdometry odometry(kCamera, parameters);
    for (int k = 0; k < 9; ++k) {
      const FrameResult result = odometry.process(synthetic::passing(k));
      EXPECT_LT(distance(result.T_odom_camera, synthetic::truePose(k)), 0.04) << k;
      EXPECT_LT(angle(result.T_odom_camera, synthetic::truePose(k)), 0.008) << k;
      if (k < synthetic::kPassingBegins) continue;
      EXPECT_EQ(result.state, TrackingState::kOk) << toString(result.reason);
      EXPECT_LT(result.counts.point_inliers, 0.5 * result.counts.point_matches) << "and it is told";
    }
  }
}

/// The right camera hangs 1.8 px low: points tell.
TEST(Faults, RowsThatDifferShowInTheMatches) {
  Parameters parameters = synthetic::roomParameters();
  parameters.tracking.refine_calibration = false;
  StereoOdometry odometry(kCamera, parameters);
  FrameResult result;
  for (int k = 0; k < 3; ++k) {
    StereoImages images = drive(k);
    const cv::Matx23d down(1.0, 0.0, 0.0, 0.0, 1.0, 1.8);
    cv::warpAffine(images.right.clone(), images.right, down, images.right.size());
    result = odometry.process(images);
  }
  ASSERT_GT(result.points.size(), 20U);
  std::vector<float> rows;
  for (const ObservedPoint& point : result.points) {
    rows.push_back(point.right_px.y() - point.left_px.y());
  }
  std::nth_element(rows.begin(), rows.begin() + rows.size() / 2, rows.end());
  EXPECT_NEAR(rows[rows.size() / 2], 1.8, 0.3);
}

// --- Standing

class StandstillTest : public ::testing::TestWithParam<int> {
 protected:
  static Parameters parameters() {
    Parameters parameters = synthetic::roomParameters();
    parameters.window.size = GetParam();
    return parameters;
  }
};

TEST_P(StandstillTest, NotABitMoves) {
  StereoOdometry odometry(kCamera, parameters());
  FrameResult rest;
  for (int k = 0; k < 100; ++k) {
    const FrameResult result = odometry.process(noisy(stamped(drive(0), stampOf(k)), 2.0));
    if (k == 10) rest = result;
    if (k < 10) continue;
    ASSERT_EQ(result.T_odom_camera.matrix(), rest.T_odom_camera.matrix()) << k;
    EXPECT_TRUE(result.twist.isZero(0.0)) << k;
    EXPECT_GT(result.twist_covariance.trace(), 0.0) << "nothing is known exactly";
  }
  EXPECT_LT(rest.T_odom_camera.translation().norm(), 0.002);
}

TEST_P(StandstillTest, StopsStandsAndGoesOn) {
  StereoOdometry odometry(kCamera, parameters());
  FrameResult last;
  for (int k = 0; k < 30; ++k) {
    const int place = std::min(k, 3) + std::max(0, k - 25);
    const FrameResult result = odometry.process(noisy(stamped(drive(place), stampOf(k)), 2.0));
    if (k >= 12 && k <= 25) {
      EXPECT_EQ(result.T_odom_camera.matrix(), last.T_odom_camera.matrix()) << k;
    }
    if (k > 0) {
      EXPECT_LT(jump(last, result).translation_m, 0.005) << k;
    }
    EXPECT_LT(distance(result.T_odom_camera, synthetic::truePose(place)), 0.02) << k;
    last = result;
  }
}

/// The motion from one frame to the next is within its noise. It adds up nevertheless; without
/// landmarks noise adds up as well.
TEST_P(StandstillTest, CreepingIsNotSwallowed) {
  const double step_m = GetParam() > 0 ? 0.0003 : 0.002;
  const double noise_m = GetParam() > 0 ? 0.007 : 0.04;
  StereoOdometry odometry(kCamera, parameters());
  FrameResult last;
  for (int k = 0; k < 60; ++k) {
    const Isometry3d ground_truth = transform(Vector3d::Zero(), {0.0, 0.0, step_m * k});
    const FrameResult result =
        odometry.process(noisy(room("creep " + std::to_string(step_m * k), ground_truth, k), 2.0));
    EXPECT_LT(distance(result.T_odom_camera, ground_truth), noise_m) << k;
    if (k > 0) {
      EXPECT_LT(jump(last, result).translation_m, 0.012) << k;
    }
    last = result;
  }
  EXPECT_GT(last.T_odom_camera.translation().z(), 0.6 * step_m * 59);
}

TEST_P(StandstillTest, CanBeSwitchedOff) {
  Parameters off = parameters();
  off.tracking.standstill_hold = false;
  StereoOdometry odometry(kCamera, off);
  FrameResult last;
  for (int k = 0; k < 15; ++k) {
    const FrameResult result = odometry.process(noisy(stamped(drive(0), stampOf(k)), 2.0));
    if (k > 0) {
      EXPECT_NE(result.T_odom_camera.matrix(), last.T_odom_camera.matrix()) << k;
    }
    last = result;
  }
}

INSTANTIATE_TEST_SUITE_P(Faults, StandstillTest, ::testing::Values(5, 0), [](const auto& info) {
  return info.param == 0 ? std::string("frame_to_frame") : std::string("landmarks");
});

// --- Exceptions

/// Wherever memory runs out in a frame, the frame is predicted and the next ones are as good as
/// ever.
TEST(Faults, ExceptionsDegradeAFrameAndNoMore) {
  int failures = 0;
  for (int last = 0;; last = last * 3 / 2 + 1) {
    StereoOdometry odometry(kCamera, synthetic::roomParameters());
    FrameResult before;
    for (int k = 0; k < 4; ++k) before = odometry.process(drive(k));
    const StereoImages images = drive(4);
    FrameResult result;
    bool failed = false;
    {
      const FailingAllocator allocator(last);
      ASSERT_NO_THROW(result = odometry.process(images)) << last;
      failed = allocator.hasFailed();
    }
    if (!failed) break;
    ++failures;
    EXPECT_EQ(result.state, TrackingState::kDegraded) << last;
    EXPECT_EQ(result.reason, TrackingReason::kException) << last;
    EXPECT_FALSE(result.error.empty());
    EXPECT_TRUE(result.accepted() && allFinite(result));
    EXPECT_LT(distance(result.T_odom_camera, synthetic::truePose(4)), 0.02) << last;
    FrameResult next;
    for (int k = 5; k < 8; ++k) next = odometry.process(drive(k));
    EXPECT_EQ(next.state, TrackingState::kOk) << toString(next.reason);
    EXPECT_LT(distance(before.T_odom_camera, next.T_odom_camera), 0.52);
  }
  EXPECT_GT(failures, 3);
}

TEST(Faults, AnExceptionInTheFirstFrameStartsWithTheNext) {
  StereoOdometry odometry(kCamera, synthetic::roomParameters());
  const StereoImages images = drive(0);
  {
    const FailingAllocator allocator(0);
    const FrameResult result = odometry.process(images);
    EXPECT_EQ(result.reason, TrackingReason::kException);
    EXPECT_TRUE(allFinite(result));
  }
  EXPECT_EQ(odometry.process(drive(1)).reason, TrackingReason::kFirstFrame);
  EXPECT_EQ(odometry.process(drive(2)).state, TrackingState::kOk);
}

}  // namespace
}  // namespace point_line_odometry
