/// The odometry in the built-in world: properties that need exact ground truth.

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "knocked_camera.h"
#include "odometry/uncertainty.h"
#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/rectification.h"
#include "point_line_odometry/stereo_odometry.h"
#include "point_line_odometry/types.h"
#include "world/synthetic_world.h"

namespace point_line_odometry {
namespace {

/// A run through a world: estimates and ground truth, both of the rectified left camera.
struct RunResult {
  std::vector<FrameResult> results;
  std::vector<Eigen::Isometry3d> ground_truth;  // relative to frame 0
};

/// Draws something into both images of a frame of the world's path.
using Draw = std::function<void(std::size_t frame, StereoImages* images)>;

/// Without masks. \param every every such frame of the world's path is taken. \param first frame of
/// it.
RunResult run(const SyntheticWorldOptions& options, std::size_t num_frames, std::size_t every = 1,
              std::size_t first = 0, const Draw& draw = nullptr,
              const Parameters& parameters = {}) {
  const SyntheticWorld world(options);
  const StereoRectifier rectifier(world.calibration());
  Eigen::Isometry3d T_rectified_raw = Eigen::Isometry3d::Identity();
  if (world.needsRectification()) T_rectified_raw.linear() = rectifier.R_rectified_raw();
  StereoOdometry odometry(rectifier.camera(), parameters);
  RunResult run_result;
  for (std::size_t i = 0; i < num_frames; ++i) {
    const std::size_t k = first + i * every;
    StereoImages images = world.render(k);
    images.left_mask = images.right_mask = cv::Mat();
    if (world.needsRectification()) images = rectifier.rectify(images);
    if (draw) draw(k, &images);
    run_result.results.push_back(odometry.process(images));
    run_result.ground_truth.push_back(T_rectified_raw * world.pose(k).T_world_camera *
                                      T_rectified_raw.inverse());
  }
  return run_result;
}

double angleDeg(const Eigen::Matrix3d& R) { return Eigen::AngleAxisd(R).angle() * 180.0 / M_PI; }

/// Squared errors, normalised by their covariances; six degrees of freedom each.
struct NormalisedErrors {
  std::vector<double> velocity;
  std::vector<double> pose;
};

/// Of the velocity since the frame before.
double normalisedVelocityError(const RunResult& run_result, std::size_t k) {
  const FrameResult& result = run_result.results[k];
  const double dt_s =
      1e-9 * static_cast<double>(result.stamp_ns - run_result.results[k - 1].stamp_ns);
  const Vector6d error =
      result.twist -
      velocityOfMotion(run_result.ground_truth[k - 1].inverse() * run_result.ground_truth[k], dt_s);
  return error.dot(result.twist_covariance.ldlt().solve(error));
}

void append(const RunResult& run_result, NormalisedErrors* errors) {
  constexpr std::size_t kPosePeriod = 4;  // errors of successive poses are nearly the same
  for (std::size_t k = 2; k < run_result.results.size(); ++k) {
    const FrameResult& result = run_result.results[k];
    EXPECT_EQ(result.state, TrackingState::kOk) << k << " " << toString(result.reason);
    const Eigen::Isometry3d& ground_truth = run_result.ground_truth[k];
    errors->velocity.push_back(normalisedVelocityError(run_result, k));
    if (k % kPosePeriod != 0) continue;
    const Eigen::AngleAxisd turn(result.T_odom_camera.linear() * ground_truth.linear().transpose());
    Vector6d of_pose;
    of_pose << result.T_odom_camera.translation() - ground_truth.translation(),
        turn.angle() * turn.axis();
    errors->pose.push_back(of_pose.dot(result.pose_covariance.ldlt().solve(of_pose)));
  }
}

double mean(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

class Consistency : public ::testing::TestWithParam<const char*> {};

/// The covariances of velocity and pose are consistent (NEES): errors normalised by them have the
/// mean square 6. Never much more, which harms a filter; less where features are located more
/// accurately than the floors of the noise say (velocity and pose: 3.4 and 3.7 in the street, 2.6
/// and 2.0 in the rooms).
TEST_P(Consistency, NormalisedErrorsAreNotTooLarge) {
  NormalisedErrors errors;
  for (const int seed : {1, 2, 3}) {
    SyntheticWorldOptions options;
    options.scene = GetParam();
    options.seed = seed;
    append(run(options, 25), &errors);
  }
  RecordProperty("mean_of_velocity", std::to_string(mean(errors.velocity)));
  RecordProperty("mean_of_pose", std::to_string(mean(errors.pose)));
  EXPECT_GT(mean(errors.velocity), 1.0);
  EXPECT_LT(mean(errors.velocity), 12.0);
  EXPECT_GT(mean(errors.pose), 1.0);
  EXPECT_LT(mean(errors.pose), 12.0);
}

INSTANTIATE_TEST_SUITE_P(Worlds, Consistency, ::testing::Values("street", "indoor"));

double largestError(const RunResult& run_result) {
  double largest = 0.0;
  for (std::size_t k = 0; k < run_result.results.size(); ++k) {
    const Eigen::Vector3d error = run_result.results[k].T_odom_camera.translation() -
                                  run_result.ground_truth[k].translation();
    largest = std::max(largest, error.norm());
  }
  return largest;
}

class RollingShutterWorld : public ::testing::TestWithParam<const char*> {};

/// What each row shows is moved to the stamp: errors and covariances are those of a global shutter.
TEST_P(RollingShutterWorld, IsFollowed) {
  NormalisedErrors errors;
  NormalisedErrors errors_without;
  for (const int seed : {1, 2}) {
    SyntheticWorldOptions options;
    options.scene = GetParam();
    options.seed = seed;
    options.rotation = 2.0;
    options.rolling_shutter_ms = 20.0;
    Parameters parameters;
    parameters.tracking.rolling_shutter_ms = 20.0;
    const RunResult followed = run(options, 40, 1, 0, nullptr, parameters);
    const RunResult ignored = run(options, 40);
    append(followed, &errors);
    append(ignored, &errors_without);
    EXPECT_LT(largestError(followed), 0.5 * largestError(ignored)) << seed;
  }
  RecordProperty("mean_of_velocity", std::to_string(mean(errors.velocity)));
  RecordProperty("mean_of_velocity_without", std::to_string(mean(errors_without.velocity)));
  EXPECT_LT(mean(errors.velocity), 12.0);
  EXPECT_LT(mean(errors.pose), 12.0);
  EXPECT_GT(mean(errors_without.velocity), 2.0 * mean(errors.velocity));
}

INSTANTIATE_TEST_SUITE_P(Worlds, RollingShutterWorld, ::testing::Values("street", "indoor"));

/// A yaw makes all disparities too large or too small: the first motion shows it. What is not known
/// of it is in the covariance.
TEST(KnockedCamera, AYawIsCorrectedFromTheFirstMotionOn) {
  SyntheticWorldOptions options;
  options.scene = "street";
  const StereoCamera camera = StereoRectifier(SyntheticWorld(options).calibration()).camera();
  for (const int seed : {1, 2}) {
    options.seed = seed;
    for (const Eigen::Vector3d& rotation_deg :
         {Eigen::Vector3d(0.0, 0.2, 0.0), Eigen::Vector3d(0.1, -0.3, 0.2)}) {
      const Draw knock = [&](std::size_t, StereoImages* images) {
        *images = knocked(*images, camera, rotation_deg);
      };
      const RunResult run_result = run(options, 12, 2, 0, knock);
      for (std::size_t k = 1; k < run_result.results.size(); ++k) {
        EXPECT_EQ(run_result.results[k].state, TrackingState::kOk) << k;
        EXPECT_LT(std::sqrt(normalisedVelocityError(run_result, k)), 6.0)
            << "seed " << seed << ", frame " << k << ", " << rotation_deg.transpose();
      }
      const Eigen::Vector3d path = run_result.ground_truth.back().translation();
      const Eigen::Vector3d error = run_result.results.back().T_odom_camera.translation() - path;
      EXPECT_LT(error.norm(), 0.01 * path.norm()) << seed << ", " << rotation_deg.transpose();
    }
  }
}

/// A camera that turns to and fro about its own axis, at 100 deg/s in the middle.
std::vector<StampedPose> turns(std::size_t num_frames) {
  constexpr double kAmplitude_rad = 0.8;
  constexpr double kFastest_rad_s = 100.0 * M_PI / 180.0;
  std::vector<StampedPose> path(num_frames);
  for (std::size_t k = 0; k < num_frames; ++k) {
    const double time_s = 0.05 * static_cast<double>(k);
    const double yaw = kAmplitude_rad * (1.0 - std::cos(kFastest_rad_s / kAmplitude_rad * time_s));
    path[k].stamp_ns = static_cast<std::int64_t>(k) * 50'000'000;
    path[k].T_world_camera.linear() =
        Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitY()).toRotationMatrix();
  }
  return path;
}

/// Of a road that comes nearer, all features appear larger, and no velocity is known that tells it.
TEST(FirstMotion, OverAHillIsAsLongAsItIs) {
  constexpr int kSeeds = 10;
  double sum = 0.0;
  double squares = 0.0;
  SyntheticWorldOptions options;
  options.hill = 1.0;
  for (options.seed = 101; options.seed < 101 + kSeeds; ++options.seed) {
    const RunResult run_result = run(options, 2);
    EXPECT_EQ(run_result.results[1].state, TrackingState::kOk) << options.seed;
    EXPECT_LT(normalisedVelocityError(run_result, 1), 36.0) << options.seed;
    const Eigen::Vector3d moved =
        (run_result.ground_truth[0].inverse() * run_result.ground_truth[1]).translation();
    const Eigen::Vector3d estimated = run_result.results[1].T_odom_camera.translation();
    sum += (estimated - moved).dot(moved) / moved.squaredNorm();
    squares += (estimated - moved).squaredNorm() / moved.squaredNorm();
  }
  EXPECT_LT(std::abs(sum / kSeeds), 0.003);       // 0.0026; 0.0067 by patches warped once
  EXPECT_LT(std::sqrt(squares / kSeeds), 0.005);  // 0.0038; 0.0087
}

/// First motions over stones that are laid in a pattern: they look alike where the camera would be
/// a repetition away, and most of what is in view is stones. No velocity tells which motion is
/// right.
struct StartsOverAPattern {
  int ok = 0;
  int ambiguous = 0;

  StartsOverAPattern(std::size_t every, const std::vector<double>& repetitions_m) {
    SyntheticWorldOptions options;
    options.open_country = 1.0;
    for (const double repetition_m : repetitions_m) {
      options.repetition_m = repetition_m;
      for (options.seed = 401; options.seed < 406; ++options.seed) {
        const RunResult run_result = run(options, 2, every);
        EXPECT_LT(normalisedVelocityError(run_result, 1), 36.0)
            << options.seed << ", every " << repetition_m << " m";
        ok += run_result.results[1].state == TrackingState::kOk ? 1 : 0;
        ambiguous += run_result.results[1].reason == TrackingReason::kAmbiguousMotion ? 1 : 0;
      }
    }
  }
};

/// 3.6 m.
TEST(FirstMotion, IsRightOverARepeatedPattern) {
  const StartsOverAPattern starts(3, {1.0, 2.0, 4.0});
  EXPECT_GE(starts.ok, 13);  // 15; by the motion with the most inliers 13 were a repetition away
}

/// 6 m: of the road little is in view in both frames.
TEST(FirstMotion, IsAmbiguousWhereAnotherMayBeRight) {
  const StartsOverAPattern starts(5, {1.0, 2.0});
  EXPECT_GE(starts.ambiguous, 3);
  EXPECT_GE(starts.ok + starts.ambiguous, 10);
}

/// 5 degrees from frame to frame at EuRoC's frame rate: the view moves by 40 pixels.
TEST(HardMotion, FastPureRotation) {
  constexpr std::size_t kFrames = 60;
  SyntheticWorldOptions options;
  options.scene = "indoor";
  options.path = turns(kFrames);
  const RunResult turning = run(options, kFrames);
  double fastest_deg = 0.0;
  for (std::size_t k = 1; k < kFrames; ++k) {
    const FrameResult& result = turning.results[k];
    EXPECT_EQ(result.state, TrackingState::kOk) << k << " " << toString(result.reason);
    const Eigen::Isometry3d& ground_truth = turning.ground_truth[k];
    EXPECT_LT((result.T_odom_camera.translation() - ground_truth.translation()).norm(), 0.01) << k;
    EXPECT_LT(angleDeg(result.T_odom_camera.linear().transpose() * ground_truth.linear()), 0.3)
        << k;
    fastest_deg = std::max(fastest_deg, angleDeg(turning.ground_truth[k - 1].linear().transpose() *
                                                 ground_truth.linear()));
  }
  EXPECT_GT(fastest_deg, 4.9) << "the test must be hard";
}

/// In a turn at every 4th frame, wrong matches of one frame agree on a motion that is 13 of its
/// standard deviations off. Among those that disagree RANSAC finds the right one.
TEST(HardMotion, WrongMatchesThatAgreeAreNotTheScene) {
  SyntheticWorldOptions options;
  options.scene = "corridor";
  options.seed = 64;
  const RunResult turning = run(options, 48, 4, 51);
  for (std::size_t k = 2; k < turning.results.size(); ++k) {
    EXPECT_EQ(turning.results[k].state, TrackingState::kOk) << k;
    EXPECT_LT(normalisedVelocityError(turning, k), 36.0) << k;
  }
}

/// In a dark corridor at every 5th frame, wrong matches agree on a motion at which few of the
/// landmarks are found that should be in view.
TEST(HardMotion, TheMapRefutesWrongMatchesThatAgree) {
  SyntheticWorldOptions options;
  options.scene = "corridor";
  options.seed = 22;
  options.rotation = 4.0;
  options.exposure_ev = -3.0;
  options.motion_blur_ms = 20.0;
  const RunResult turning = run(options, 14, 5);
  int refuted = 0;
  for (std::size_t k = 2; k < turning.results.size(); ++k) {
    const FrameResult& result = turning.results[k];
    const FrameResult& before = turning.results[k - 1];
    if (result.state == TrackingState::kOk && before.state == TrackingState::kOk) {
      EXPECT_LT(normalisedVelocityError(turning, k), 36.0) << k;
    }
    if (result.state == TrackingState::kOk) continue;
    ++refuted;
    EXPECT_EQ(result.reason, TrackingReason::kTooFewInliers);
    EXPECT_GE(result.counts.point_matches, 30) << "the test must be hard";
    EXPECT_EQ(result.counts.point_inliers, 0);
  }
  EXPECT_EQ(refuted, 1);
}

/// Every fourth frame of a drive in the dark, of which little is found again. Where 15 of 96
/// matches agree that the robot has nearly stopped, it would have braked by 30 m/s^2: that is not
/// believed.
TEST(HardMotion, FewMatchesDoNotStopAFastRobot) {
  SyntheticWorldOptions options;
  options.seed = 4;
  options.speed = 1.5;
  options.exposure_ev = -3.0;
  options.moving_objects = 40;
  const RunResult driven = run(options, 13, 4, 160);
  for (std::size_t k = 2; k < driven.results.size(); ++k) {
    const FrameResult& result = driven.results[k];
    EXPECT_NE(result.state, TrackingState::kLost) << k;
    if (result.state == TrackingState::kOk) {
      EXPECT_LT(normalisedVelocityError(driven, k), 36.0) << k;
    }
  }
}

/// Every fourth frame of a drive to the end of a corridor, where few features are in view and a
/// turn begins that the velocity does not predict.
TEST(HardMotion, ATurnBeforeAPlainWallIsFollowed) {
  SyntheticWorldOptions options;
  options.scene = "corridor";
  options.seed = 11;
  options.motion_blur_ms = 15.0;
  options.noise = 6.0;
  const RunResult driven = run(options, 52, 4);
  for (std::size_t k = 1; k < driven.results.size(); ++k) {
    EXPECT_EQ(driven.results[k].state, TrackingState::kOk)
        << k << " " << toString(driven.results[k].reason);
    EXPECT_LT(normalisedVelocityError(driven, k), 36.0) << k;
  }
}

/// Each motion is right to a few centimetres.
void expectAllFollowed(const RunResult& run_result) {
  for (std::size_t k = 1; k < run_result.results.size(); ++k) {
    const FrameResult& result = run_result.results[k];
    EXPECT_EQ(result.state, TrackingState::kOk) << k << " " << toString(result.reason);
    const Eigen::Isometry3d error =
        (run_result.ground_truth[k - 1].inverse() * run_result.ground_truth[k]).inverse() *
        run_result.results[k - 1].T_odom_camera.inverse() * result.T_odom_camera;
    EXPECT_LT(error.translation().norm(), 0.05) << k;
    EXPECT_LT(angleDeg(error.linear()), 0.1) << k;
  }
}

/// What a camera writes into its images rests there, and has no disparity. The scene is 4 m further
/// in each frame, so that near the prediction of a camera at rest only the text is found.
TEST(DrawnOver, TextIsNotTheScene) {
  const Draw text = [](std::size_t frame, StereoImages* images) {
    for (cv::Mat* image : {&images->left, &images->right}) {
      for (int line = 0; line < 4; ++line) {
        const std::string number = std::to_string(100 * line + static_cast<int>(frame));
        cv::putText(*image, "CAMERA " + number + " 2026-01-02 12:34:56 REC +0.34 dB",
                    {10, 30 + 87 * line}, cv::FONT_HERSHEY_SIMPLEX, 0.9, cv::Scalar(255), 2);
      }
    }
  };
  SyntheticWorldOptions options;
  options.seed = 9;
  expectAllFollowed(run(options, 15, 4, 0, text));
}

/// A lorry that overtakes at 13 m fills up to half of the view and has five times as many features
/// as the rest of it.
TEST(DrawnOver, ALorryThatFillsHalfOfTheViewIsNotTheScene) {
  constexpr int kDisparity_px = 30;
  constexpr int kSpeed_px = 12;
  constexpr int kEnters = 8;
  cv::Mat lorry(400, 620, CV_8UC1);
  cv::RNG random(5);
  random.fill(lorry, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(lorry, lorry, cv::Size(), 2.0);
  lorry = 3.0 * (lorry - 85);
  const Draw overtaking = [&](std::size_t frame, StereoImages* images) {
    for (cv::Mat* image : {&images->left, &images->right}) {
      const int rear = kSpeed_px * (static_cast<int>(frame) - kEnters) - lorry.cols -
                       (image == &images->right ? kDisparity_px : 0);
      const cv::Rect seen =
          cv::Rect(rear, 56, lorry.cols, lorry.rows) & cv::Rect(0, 0, image->cols, image->rows);
      if (seen.empty()) continue;
      lorry(seen - cv::Point(rear, 56)).copyTo((*image)(seen));
    }
  };
  SyntheticWorldOptions options;
  options.seed = 5;
  expectAllFollowed(run(options, 15, 4, 0, overtaking));
}

struct BodyCase {
  const char* scene;
  std::size_t every;
};

class RobotsOwnBody : public ::testing::TestWithParam<BodyCase> {};

/// A third of the view is the robot's own bonnet, which has more texture than the scene has.
TEST_P(RobotsOwnBody, IsNotTheScene) {
  SyntheticWorldOptions options;
  options.scene = GetParam().scene;
  options.bonnet = 1.0;
  const RunResult driven = run(options, 20, GetParam().every);
  const Eigen::Isometry3d& last = driven.ground_truth.back();
  for (std::size_t k = 1; k < driven.results.size(); ++k) {
    const FrameResult& result = driven.results[k];
    if (result.state == TrackingState::kOk) {
      EXPECT_LT(normalisedVelocityError(driven, k), 36.0) << k;
    }
    EXPECT_NE(result.state, TrackingState::kLost) << k;
  }
  const double path_m = last.translation().norm();
  EXPECT_GT(path_m, 0.3) << "the test must move";
  EXPECT_LT((driven.results.back().T_odom_camera.translation() - last.translation()).norm(),
            0.02 * path_m + 0.005);
}

INSTANTIATE_TEST_SUITE_P(Worlds, RobotsOwnBody,
                         ::testing::Values(BodyCase{"corridor", 1}, BodyCase{"corridor", 3},
                                           BodyCase{"indoor", 1}, BodyCase{"indoor", 3},
                                           BodyCase{"plaster", 1}, BodyCase{"plaster", 3},
                                           BodyCase{"street", 1}, BodyCase{"street", 3}));

/// In the dark a frame shows few points of the scene: the first ones may be wrong.
TEST(RobotsOwnBody, IsNotTheSceneInTheDark) {
  SyntheticWorldOptions options;
  options.scene = "plaster";
  options.seed = 2561;
  options.bonnet = 1.0;
  options.speed = 0.6;
  options.exposure_ev = -0.6;
  const RunResult driven = run(options, 30);
  for (std::size_t k = 4; k < driven.results.size(); ++k) {
    if (driven.results[k].state == TrackingState::kOk) {
      EXPECT_LT(normalisedVelocityError(driven, k), 36.0) << k;
    }
    EXPECT_NE(driven.results[k].state, TrackingState::kLost) << k;
  }
  EXPECT_EQ(driven.results.back().state, TrackingState::kOk);
}

/// What is blurred or too dark is not found again, and all that is found is the robot. Its motion
/// is unknown then, and said to be.
TEST(RobotsOwnBody, IsNotTheSceneWhereThatIsNotFound) {
  struct Case {
    int seed;
    double speed;
    double rotation;
    double exposure_ev;
    std::size_t every;
  };
  for (const Case& dark : {Case{77406, 1.5, 2.0, 0.0, 2}, Case{73149, 1.0, 1.0, -0.6, 3}}) {
    SyntheticWorldOptions options;
    options.scene = "plaster";
    options.seed = dark.seed;
    options.bonnet = 1.5;
    options.speed = dark.speed;
    options.rotation = dark.rotation;
    options.exposure_ev = dark.exposure_ev;
    const RunResult driven = run(options, 12, dark.every);
    int doubted = 0;
    for (std::size_t k = 1; k < driven.results.size(); ++k) {
      if (driven.results[k].state == TrackingState::kOk) {
        EXPECT_LT(normalisedVelocityError(driven, k), 36.0) << dark.seed << ' ' << k;
      }
      doubted += driven.results[k].reason == TrackingReason::kAmbiguousMotion ? 1 : 0;
    }
    EXPECT_GT(doubted, 0) << "the test must hide the scene";
    EXPECT_EQ(driven.results.back().state, TrackingState::kOk) << dark.seed;
  }
}

/// A camera at rest finds part of the scene in the dark, too.
TEST(RobotsOwnBody, IsNotAllThatAStandingRobotSeesInTheDark) {
  for (const double exposure_ev : {0.0, -1.0}) {
    SyntheticWorldOptions options;
    options.scene = "plaster";
    options.bonnet = 1.5;
    options.speed = 0.0;
    options.rotation = 0.0;
    options.exposure_ev = exposure_ev;
    const RunResult standing = run(options, 8);
    for (std::size_t k = 1; k < standing.results.size(); ++k)
      EXPECT_EQ(standing.results[k].state, TrackingState::kOk) << exposure_ev << ' ' << k;
  }
}

/// Cars pass before a robot that stands and sees its own bonnet.
TEST(RobotsOwnBody, TrafficDoesNotMoveAStandingRobot) {
  SyntheticWorldOptions options;
  options.bonnet = 1.0;
  options.speed = 0.0;
  options.moving_objects = 40;
  const RunResult standing = run(options, 30);
  for (std::size_t k = 0; k < standing.results.size(); ++k) {
    const Eigen::Vector3d sway = standing.ground_truth[k].translation();
    EXPECT_LT((standing.results[k].T_odom_camera.translation() - sway).norm(), 0.005) << k;
  }
}

/// Behind a road on which little is seen, cars have many of the points.
TEST(RobotsOwnBody, TrafficInOpenCountryIsNotTheScene) {
  SyntheticWorldOptions options;
  options.seed = 5;
  options.open_country = 1.0;
  options.speed = 0.0;
  options.rotation = 0.0;
  options.moving_objects = 15;
  const RunResult standing = run(options, 20);
  for (std::size_t k = 1; k < standing.results.size(); ++k) {
    EXPECT_EQ(standing.results[k].state, TrackingState::kOk) << k;
    EXPECT_LT(standing.results[k].T_odom_camera.translation().norm(), 0.005) << k;
  }
}

}  // namespace
}  // namespace point_line_odometry
