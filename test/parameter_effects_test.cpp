/// Every parameter of the core has an effect: another value of it changes the poses of a scene made
/// for it. Those that cannot are listed with the reason.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <ostream>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "features/lsd_detector.h"
#include "geometry/camera_axes.h"
#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/gravity.h"
#include "point_line_odometry/gyroscope.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_odometry.h"
#include "point_line_odometry/types.h"
#include "point_line_odometry/wheel_odometry.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using synthetic::kFrames;
using synthetic::kPeriodNs;
using synthetic::passing;
using synthetic::room;
using synthetic::stamped;
using synthetic::transform;

const StereoCamera kCamera = synthetic::roomCamera();

StereoImages noisy(StereoImages images, double sigma) {
  cv::RNG random(static_cast<std::uint64_t>(images.stamp_ns));
  for (cv::Mat* image : {&images.left, &images.right}) {
    cv::Mat noise(image->size(), CV_16SC1);
    random.fill(noise, cv::RNG::NORMAL, 0.0, sigma);
    cv::Mat sum;
    cv::add(*image, noise, sum, cv::noArray(), CV_8UC1);
    *image = sum;
  }
  return images;
}

// --- Scenes: frame k of each. The camera is kCamera.

/// Forwards with a gentle curve, and the noise of a sensor.
StereoImages drive(int k) { return noisy(synthetic::frame(k), 3.0); }

/// The same with two black frames.
StereoImages darkness(int k) {
  return k == 4 || k == 5 ? synthetic::black((k + 1) * kPeriodNs) : drive(k);
}

/// Frames are missing for 1.2 s.
StereoImages gap(int k) {
  return stamped(drive(k), (k + 1) * kPeriodNs + (k >= 4 ? 12 * kPeriodNs : 0));
}

/// Three frames upside down, after a gap, then upright again.
StereoImages excursion(int k) {
  StereoImages images = drive(k < 7 ? k : k - 4);
  for (cv::Mat* image : {&images.left, &images.right}) {
    if (k >= 4 && k < 7) cv::flip(image->clone(), *image, 0);
  }
  return stamped(images, (k + 1) * kPeriodNs + (k >= 4 ? 12 * kPeriodNs : 0));
}

/// After standing still the camera rotates by 25 degrees within a frame, and continues so.
StereoImages turn(int k) {
  const int n = std::max(k - 2, 0);
  return room("turn " + std::to_string(n),
              transform({0.0, n * 25.0 * M_PI / 180.0, 0.0}, n * Vector3d(0.1, 0.0, 0.2)), k);
}

/// Standing still, with 0.9 s between frames.
StereoImages slow(int k) {
  return noisy(stamped(synthetic::frame(0), (k + 1) * 9 * kPeriodNs), 2.0);
}

StereoImages standing(int k) {
  return noisy(stamped(synthetic::frame(0), (k + 1) * kPeriodNs), 2.0);
}

/// So blurred and dark that the finest level has few keypoints.
StereoImages soft(int k) {
  StereoImages images = synthetic::frame(k);
  for (cv::Mat* image : {&images.left, &images.right}) {
    cv::Mat changed;
    cv::GaussianBlur(*image, changed, {}, 5.0);
    changed.convertTo(changed, CV_8UC1, 0.3, 20.0);
    *image = changed;
  }
  return noisy(images, 5.0);
}

// --- Poses

using Scene = StereoImages (*)(int);

/// Poses and states of all frames.
struct Outcome {
  std::vector<Eigen::Matrix4d> poses;
  std::vector<TrackingState> states;

  bool operator==(const Outcome& other) const {
    return poses == other.poses && states == other.states;
  }
};

/// A gyroscope in the camera's axes that turns as in drive(), and trembles.
Gyroscope turning(const ImuParameters& parameters) {
  Gyroscope gyroscope(parameters, Eigen::Matrix3d::Identity());
  for (int i = 0; i < 100 * (kFrames + 2); ++i) {
    ImuSample sample;
    sample.stamp_ns = i * kPeriodNs / 10;
    sample.angular_velocity = Vector3d(0.02, -0.12 + 0.1 * std::sin(0.5 * i), 0.03);
    // A direction that turns by 2 mrad in a second.
    const double tilt = 0.002 * toSeconds(sample.stamp_ns);
    sample.acceleration = 9.81 * Vector3d(std::sin(tilt), -std::cos(tilt), 0.0);
    gyroscope.add(sample);
  }
  return gyroscope;
}

/// The camera in a body with x ahead and z up.
Isometry3d cameraInBody() {
  Isometry3d T = Isometry3d::Identity();
  T.linear() = cameraAxesInBody();
  return T;
}

/// Wheels that know the motion of drive(), a little wrong.
WheelOdometry rolling(const Parameters& parameters) {
  WheelOdometry wheels(parameters, cameraInBody());
  for (int k = 0; k < kFrames; ++k) {
    OdometrySample sample;
    sample.stamp_ns = (k + 1) * kPeriodNs;
    sample.T_odom_body = cameraInBody() * synthetic::truePose(k) * cameraInBody().inverse();
    sample.T_odom_body.translation() *= 1.02;
    wheels.add(sample);
  }
  return wheels;
}

Outcome run(Scene scene, const Parameters& parameters) {
  StereoOdometry odometry(kCamera, parameters);
  Gyroscope gyroscope = turning(parameters.imu);
  Gravity gravity(parameters.imu, Eigen::Isometry3d::Identity());
  WheelOdometry wheels = rolling(parameters);
  Outcome outcome;
  std::int64_t last_ns = 0;
  for (int k = 0; k < kFrames; ++k) {
    const StereoImages images = scene(k);
    std::vector<MotionPrior> priors;
    if (parameters.imu.enabled && k > 0) {
      if (const auto prior = gyroscope.between(last_ns, images.stamp_ns)) priors.push_back(*prior);
    }
    if (parameters.wheels.enabled && k > 0) {
      if (const auto prior = wheels.between(last_ns, images.stamp_ns)) priors.push_back(*prior);
    }
    if (parameters.planar.enabled && k > 0)
      priors.push_back(planarPrior(parameters.planar, cameraInBody(), last_ns, images.stamp_ns));
    const std::optional<MotionPrior> prior = fused(priors);
    const auto tilt = gravity.takeCorrection();
    if (parameters.imu.enabled && parameters.imu.use_gravity && tilt) odometry.correctTilt(*tilt);
    const FrameResult result = odometry.process(images, prior ? &*prior : nullptr);
    gyroscope.update(result);
    gravity.update(result, gyroscope);
    wheels.update(result);
    last_ns = images.stamp_ns;
    outcome.poses.emplace_back(result.T_odom_camera.matrix());
    outcome.states.push_back(result.state);
  }
  return outcome;
}

// --- The cases

/// A case in which a parameter has an effect: a scene, and the other parameters.
struct Case {
  std::string name;
  std::function<void(Parameters*)> change;
  Scene scene = drive;
  std::function<void(Parameters*)> base = [](Parameters*) {};
};

std::ostream& operator<<(std::ostream& stream, const Case& test_case) {
  return stream << test_case.name;
}

void frameToFrame(Parameters* p) { p->window.size = 0; }

/// Most points of the room are treated as far points.
void mostFar(Parameters* p) {
  frameToFrame(p);
  p->matching.min_disparity_px = 12.0;
}

/// Lines only, and of these the vertical ones, which hardly constrain a motion along them.
void uprightLines(Parameters* p) {
  frameToFrame(p);
  p->points.enabled = false;
  p->motion.min_line_angle_deg = 60.0;
}

/// The fusion also depends on the outliers.
void withoutFusion(Parameters* p) {
  frameToFrame(p);
  p->motion.fuse_rotation = "never";
}

/// Whole pixels also disable the online stereo calibration, which is not the effect to be tested.
void withoutRefinement(Parameters* p) {
  frameToFrame(p);
  p->tracking.refine_calibration = false;
}

/// Every frame is a keyframe, and soon leaves the window.
void manyKeyframes(Parameters* p) {
  p->window.keyframe_overlap = 0.95;
  p->window.size = 2;
}

void withGyroscope(Parameters* p) { p->imu.enabled = true; }

/// The published pose of a camera at rest is kept, whatever its estimate does.
void withGravity(Parameters* p) {
  withGyroscope(p);
  p->tracking.standstill_hold = false;
}

/// In which a prediction without a prior ends soon.
void withGyroscopeInTheDark(Parameters* p) {
  withGyroscope(p);
  p->tracking.max_prediction_s = 0.1;
}

void withWheels(Parameters* p) { p->wheels.enabled = true; }
void withFloor(Parameters* p) { p->planar.enabled = true; }

const std::vector<Case>& cases() {
  using P = Parameters*;
  static const std::vector<Case> all{
      {"points/enabled", [](P p) { p->points.enabled = false; }},
      {"points/cell_size_px", [](P p) { p->points.cell_size_px = 80; }, drive, frameToFrame},
      {"points/max_per_cell", [](P p) { p->points.max_per_cell = 3; }, drive, frameToFrame},
      {"points/levels", [](P p) { p->points.levels = 1; }, soft},
      {"points/scale_factor", [](P p) { p->points.scale_factor = 1.2; }, soft},
      {"points/fast_threshold", [](P p) { p->points.fast_threshold = 40; }, drive, frameToFrame},
      {"points/descriptor", [](P p) { p->points.descriptor = "orb"; }, drive, frameToFrame},
      {"lines/enabled", [](P p) { p->lines.enabled = false; }},
      {"lines/detector", [](P p) { p->lines.detector = "lsd_or_edge_chains"; }, drive,
       frameToFrame},
      {"lines/min_length_px", [](P p) { p->lines.min_length_px = 40.0; }, drive, frameToFrame},
      {"lines/max_count", [](P p) { p->lines.max_count = 20; }, drive, frameToFrame},
      {"lines/min_gradient", [](P p) { p->lines.min_gradient = 30.0; }, drive, frameToFrame},
      {"lines/max_deviation_px", [](P p) { p->lines.max_deviation_px = 0.4; }, drive, frameToFrame},
      {"lines/coarse_to_fine_points", [](P p) { p->lines.coarse_to_fine_points = 100; }, drive,
       frameToFrame},
      {"matching/max_disparity_px", [](P p) { p->matching.max_disparity_px = 15.0; }, drive,
       frameToFrame},
      {"matching/min_disparity_px", [](P p) { p->matching.min_disparity_px = 12.0; }, drive,
       frameToFrame},
      {"matching/max_row_difference_px", [](P p) { p->matching.max_row_difference_px = 0.5; },
       drive, frameToFrame},
      {"matching/search_radius_px", [](P p) { p->matching.search_radius_px = 2.0; }, drive,
       frameToFrame},
      {"matching/search_radius_without_velocity_px",
       [](P p) { p->matching.search_radius_without_velocity_px = 5.0; }, drive, frameToFrame},
      {"matching/max_point_distance", [](P p) { p->matching.max_point_distance = 20; }, drive,
       frameToFrame},
      {"matching/max_line_distance", [](P p) { p->matching.max_line_distance = 10; }, drive,
       frameToFrame},
      {"matching/max_distance_ratio", [](P p) { p->matching.max_distance_ratio = 0.5; }, drive,
       frameToFrame},
      {"matching/max_line_angle_deg", [](P p) { p->matching.max_line_angle_deg = 0.5; }, drive,
       frameToFrame},
      {"matching/min_line_overlap", [](P p) { p->matching.min_line_overlap = 0.99; }, drive,
       frameToFrame},
      {"matching/min_line_length_ratio", [](P p) { p->matching.min_line_length_ratio = 0.97; },
       drive, frameToFrame},
      {"matching/refine_subpixel", [](P p) { p->matching.refine_subpixel = false; }, drive,
       withoutRefinement},
      {"matching/keep_far_points", [](P p) { p->matching.keep_far_points = false; }, drive,
       mostFar},
      {"matching/wide_search", [](P p) { p->matching.wide_search = false; }, turn, frameToFrame},
      {"motion/residual_images", [](P p) { p->motion.residual_images = "left"; }, drive,
       frameToFrame},
      {"motion/fuse_rotation", [](P p) { p->motion.fuse_rotation = "never"; }, drive, frameToFrame},
      {"motion/fuse_rotation", [](P p) { p->motion.fuse_rotation = "always"; }},
      {"motion/point_noise_px", [](P p) { p->motion.point_noise_px = 0.5; }, drive, frameToFrame},
      {"motion/line_noise_px", [](P p) { p->motion.line_noise_px = 0.5; }, drive, frameToFrame},
      {"motion/edge_noise_px", [](P p) { p->motion.edge_noise_px = 0.0; }, drive, frameToFrame},
      {"motion/adapt_noise", [](P p) { p->motion.adapt_noise = false; }},
      {"motion/min_line_angle_deg", [](P p) { p->motion.min_line_angle_deg = 60.0; }, drive,
       frameToFrame},
      {"motion/huber_delta", [](P p) { p->motion.huber_delta = 0.5; }, drive, frameToFrame},
      {"motion/remove_outliers", [](P p) { p->motion.remove_outliers = false; }, drive,
       withoutFusion},
      {"motion/outlier_threshold", [](P p) { p->motion.outlier_threshold = 1.0; }, drive,
       frameToFrame},
      {"motion/solve_near_prediction", [](P p) { p->motion.solve_near_prediction = false; },
       passing, frameToFrame},
      {"motion/predict_weak_axes", [](P p) { p->motion.predict_weak_axes = false; }, drive,
       uprightLines},
      {"motion/min_matches", [](P p) { p->motion.min_matches = 1000; }, drive, frameToFrame},
      {"motion/min_inliers", [](P p) { p->motion.min_inliers = 1000; }, drive, frameToFrame},
      {"motion/min_inlier_ratio", [](P p) { p->motion.min_inlier_ratio = 1.0; }, drive,
       frameToFrame},
      {"motion/use_triangulation_covariance",
       [](P p) { p->motion.use_triangulation_covariance = false; }, drive, frameToFrame},
      {"window/size", [](P p) { p->window.size = 0; }},
      {"window/keyframe_overlap", [](P p) { p->window.keyframe_overlap = 0.95; }},
      {"window/points_per_cell", [](P p) { p->window.points_per_cell = 2; }},
      {"local_map/size", [](P p) { p->local_map.size = 0; }, drive, manyKeyframes},
      {"local_map/search_radius_px", [](P p) { p->local_map.search_radius_px = 1.0; }, darkness},
      {"tracking/max_frame_gap_s", [](P p) { p->tracking.max_frame_gap_s = 2.0; }, gap},
      {"tracking/max_prediction_s", [](P p) { p->tracking.max_prediction_s = 0.1; }, darkness},
      {"tracking/relocalization_s", [](P p) { p->tracking.relocalization_s = 0.0; }, excursion},
      {"tracking/max_speed_m_s", [](P p) { p->tracking.max_speed_m_s = 1.0; }},
      {"tracking/max_turn_rate_deg_s", [](P p) { p->tracking.max_turn_rate_deg_s = 5.0; }},
      {"tracking/standstill_hold", [](P p) { p->tracking.standstill_hold = false; }, standing},
      {"tracking/refine_calibration", [](P p) { p->tracking.refine_calibration = false; }, drive,
       frameToFrame},
      {"tracking/rolling_shutter_ms", [](P p) { p->tracking.rolling_shutter_ms = 20.0; }},
      {"tracking/min_megapixels", [](P p) { p->tracking.min_megapixels = 0.2; }},
      {"tracking/max_prior_prediction_s", [](P p) { p->tracking.max_prior_prediction_s = 0.0; },
       darkness, withGyroscopeInTheDark},
      {"imu/enabled", withGyroscope},
      {"imu/gyroscope_noise", [](P p) { p->imu.gyroscope_noise = 0.1; }, drive, withGyroscope},
      {"imu/gyroscope_random_walk", [](P p) { p->imu.gyroscope_random_walk = 0.5; }, drive,
       withGyroscope},
      {"imu/range_deg_s", [](P p) { p->imu.range_deg_s = 10.0; }, drive, withGyroscope},
      {"imu/time_offset_s", [](P p) { p->imu.time_offset_s = 0.03; }, drive, withGyroscope},
      {"imu/estimate_time_offset", [](P p) { p->imu.estimate_time_offset = false; }, drive,
       withGyroscope},
      {"imu/use_gravity", [](P p) { p->imu.use_gravity = false; }, slow, withGravity},
      {"imu/accelerometer_noise", [](P p) { p->imu.accelerometer_noise = 0.2; }, slow, withGravity},
      {"imu/accelerometer_random_walk", [](P p) { p->imu.accelerometer_random_walk = 0.5; }, slow,
       withGravity},
      {"wheels/enabled", withWheels},
      {"wheels/slip_x", [](P p) { p->wheels.slip_x = 1.0; }, drive, withWheels},
      {"wheels/slip_y", [](P p) { p->wheels.slip_y = 1.0; }, drive, withWheels},
      {"wheels/slip_yaw", [](P p) { p->wheels.slip_yaw = 1.0; }, drive, withWheels},
      {"wheels/speed_noise", [](P p) { p->wheels.speed_noise = 1.0; }, drive, withWheels},
      {"wheels/turn_noise", [](P p) { p->wheels.turn_noise = 1.0; }, drive, withWheels},
      {"planar/enabled", withFloor},
      {"planar/z_deviation", [](P p) { p->planar.z_deviation = 1.0; }, drive, withFloor},
      {"planar/roll_deviation", [](P p) { p->planar.roll_deviation = 1.0; }, drive, withFloor},
      {"planar/pitch_deviation", [](P p) { p->planar.pitch_deviation = 1.0; }, drive, withFloor},
      {"tracking/max_megapixels", [](P p) { p->tracking.max_megapixels = 0.05; }},
      {"tracking/landmark_frames", [](P p) { p->tracking.landmark_frames = 1; }},
  };
  return all;
}

/// Parameters without an effect, and why.
const std::map<std::string, const char*>& withoutEffect() {
  static const std::map<std::string, const char*> all{
      {"tracking/threads", "results do not depend on it, only their time does"}};
  return all;
}

Parameters baseOf(const Case& test_case) {
  Parameters parameters = synthetic::roomParameters();
  test_case.base(&parameters);
  return parameters;
}

class ParameterEffect : public ::testing::TestWithParam<Case> {};

TEST_P(ParameterEffect, ChangesThePoses) {
  const Parameters base = baseOf(GetParam());
  Parameters changed = base;
  GetParam().change(&changed);
  const ParameterTexts differences = changedParameters(base, changed);
  ASSERT_EQ(differences.size(), 1U);
  EXPECT_EQ(differences[0].first, GetParam().name);
  ASSERT_TRUE(checkParameters(changed).empty()) << checkParameters(changed)[0];
  if (GetParam().name == "lines/detector" && !LsdDetector::isAvailable())
    GTEST_SKIP() << "this OpenCV has no line segment detector";
  EXPECT_FALSE(run(GetParam().scene, base) == run(GetParam().scene, changed))
      << GetParam().name << " " << differences[0].second << " is ignored";
}

INSTANTIATE_TEST_SUITE_P(Each, ParameterEffect, ::testing::ValuesIn(cases()), [](const auto& info) {
  std::string name = info.param.name + "_" + std::to_string(info.index);
  std::replace(name.begin(), name.end(), '/', '_');
  return name;
});

TEST(ParameterEffects, EveryParameterIsTried) {
  std::set<std::string> tried;
  for (const Case& test_case : cases()) tried.insert(test_case.name);
  std::set<std::string> known;
  for (const auto& [name, value] : parameterTexts({})) {
    known.insert(name);
    EXPECT_NE(tried.count(name), withoutEffect().count(name))
        << name << ": give it a case, or the reason why it has none";
  }
  for (const std::string& name : tried) EXPECT_EQ(known.count(name), 1U) << name;
}

TEST(ParameterEffects, ExemptedParametersHaveNone) {
  Parameters one_thread;
  one_thread.tracking.threads = 1;
  EXPECT_TRUE(run(drive, {}) == run(drive, one_thread));
  EXPECT_EQ(withoutEffect().size(), 1U) << "try each of them here";
}

/// What config/paper.yaml does not name has no effect there.
TEST(ParameterEffects, PaperYamlNamesAllThatTheMethodDependsOn) {
  const Parameters paper = loadParameters(TEST_REPOSITORY_DIR "/config/paper.yaml");
  Parameters other = paper;
  other.window.keyframe_overlap = 0.95;
  other.window.points_per_cell = 2;
  other.local_map.size = 0;
  other.local_map.search_radius_px = 1.0;
  other.tracking.threads = 1;
  other.tracking.relocalization_s = 0.0;
  other.tracking.max_prior_prediction_s = 0.0;
  other.imu = {false, 1e-3, 1e-3, 500.0, 0.01, false};
  other.wheels = {false, 0.2, 0.2, 0.2, 0.1, 0.1};
  other.planar = {false, 0.1, 0.1, 0.1};
  EXPECT_EQ(changedParameters(paper, other).size(), 20U);
  for (const Scene scene : {drive, darkness, excursion})
    EXPECT_TRUE(run(scene, paper) == run(scene, other));
}

}  // namespace
}  // namespace point_line_odometry
