// Landmarks: EKF updates, bundle adjustment, the local map and its bounds, and the odometry with a
// map.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <string>
#include <tuple>
#include <vector>

#include "features/features.h"
#include "map/bundle_adjustment.h"
#include "map/landmarks.h"
#include "map/local_map.h"
#include "map/new_landmarks.h"
#include "matching/stereo_frame.h"
#include "motion/correspondence.h"
#include "motion/motion_estimator.h"
#include "odometry/pose_integrator.h"
#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_correction.h"
#include "point_line_odometry/stereo_odometry.h"
#include "point_line_odometry/types.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

// --- GaussianEstimate

/// Repeated observations of a scalar: the estimate is the weighted mean.
TEST(GaussianEstimate, IsTheWeightedMean) {
  GaussianEstimate<1, 1> estimate;
  estimate.value(0) = 2.0;
  estimate.sqrt_covariance(0) = 0.5;
  using Scalar = Eigen::Matrix<double, 1, 1>;
  // residual = observed - value, observed 3.0 with sigma 0.25
  ASSERT_TRUE(estimate.update<1>(Scalar(3.0 - 2.0), Scalar(-1.0), Scalar(0.0625)));
  const double weight_before = 1.0 / 0.25;
  const double weight_seen = 1.0 / 0.0625;
  EXPECT_NEAR(estimate.value(0),
              (2.0 * weight_before + 3.0 * weight_seen) / (weight_before + weight_seen), 1e-12);
  EXPECT_NEAR(estimate.covariance()(0), 1.0 / (weight_before + weight_seen), 1e-12);
}

TEST(GaussianEstimate, UnmeasuredDirectionsAreUnchanged) {
  PointEstimate estimate;
  estimate.value = {1.0, 2.0, 3.0};
  estimate.sqrt_covariance = 0.1 * Matrix3d::Identity();
  Eigen::Matrix<double, 1, 3> by_value(-1.0, 0.0, 0.0);
  ASSERT_TRUE(estimate.update<1>(Eigen::Matrix<double, 1, 1>(0.5), by_value,
                                 Eigen::Matrix<double, 1, 1>(1e-8)));
  EXPECT_NEAR(estimate.value.x(), 1.5, 1e-5);
  EXPECT_NEAR(estimate.value.y(), 2.0, 1e-12);
  EXPECT_NEAR(estimate.covariance()(1, 1), 0.01, 1e-12);
  EXPECT_LT(estimate.covariance()(0, 0), 1e-7);
}

TEST(GaussianEstimate, RejectsUpdatesThatAreNotFinite) {
  PointEstimate estimate;
  estimate.sqrt_covariance = Matrix3d::Identity();
  const PointEstimate before = estimate;
  const Vector3d nan = Vector3d::Constant(std::nan(""));
  EXPECT_FALSE(estimate.update<3>(nan, -Matrix3d::Identity(), Matrix3d::Identity()));
  EXPECT_FALSE(estimate.update<3>(Vector3d::Zero(), -Matrix3d::Identity(), -Matrix3d::Identity()));
  EXPECT_EQ(estimate.value, before.value);
  EXPECT_EQ(estimate.sqrt_covariance, before.sqrt_covariance);
}

// --- Bundle adjustment

constexpr double kNoisePx = 0.2;

/// Keyframes on a curve that observe points and lines: ground truth, and a problem with perturbed
/// initial values.
struct BundleWorld {
  StereoCamera camera = synthetic::camera();
  std::vector<Isometry3d> poses;
  std::vector<Vector3d> points;
  std::vector<LineEstimate::Value> lines;
  BundleProblem problem;

  BundleWorld(double noise_px, int num_points, int num_lines) {
    synthetic::Random random(5);
    for (int k = 0; k < 5; ++k)
      poses.push_back(
          synthetic::transform({0.01 * k, -0.02 * k, 0.005 * k}, {0.05 * k, -0.02 * k, 0.3 * k}));
    for (int k = 0; k < 5; ++k) {
      const Isometry3d off =
          k < 2 ? Isometry3d::Identity()
                : synthetic::transform({0.004, -0.003, 0.002}, {0.03, -0.02, 0.02});
      problem.frames.push_back({static_cast<std::uint64_t>(k), poses[k] * off, k < 2});
    }
    const auto noise = [&] { return random.normals<2>(noise_px); };
    for (int i = 0; i < num_points; ++i) {
      points.push_back(poses[2] * synthetic::visiblePoint(camera, &random));
      problem.points.emplace_back();
      auto& landmark = problem.points.back();
      landmark.id = static_cast<std::uint64_t>(i);
      landmark.estimate.value = points.back() + random.normals<3>(0.05);
      landmark.estimate.sqrt_covariance = 0.05 * Matrix3d::Identity();
      for (int k = 0; k < 5; ++k) {
        const Vector3d p = poses[k].inverse() * points.back();
        PointObservation observation;
        observation.left_px = camera.projectLeft(p) + noise();
        observation.right_px = camera.projectRight(p) + noise();
        observation.sigma_px = kNoisePx;
        landmark.observations.push_back({k, observation});
      }
    }
    for (int i = 0; i < num_lines; ++i) {
      const Vector3d start = poses[2] * synthetic::visiblePoint(camera, &random);
      const Vector3d end = start + Vector3d(0.4 * (i % 3 - 1), 1.0, 0.3 * (i % 2));
      LineEstimate::Value ends;
      ends << start, end;
      lines.push_back(ends);
      problem.lines.emplace_back();
      auto& landmark = problem.lines.back();
      landmark.id = static_cast<std::uint64_t>(1000 + i);
      // Each end point moves in two directions normal to the line.
      const Vector3d along = (end - start).normalized();
      const Vector3d a = along.unitOrthogonal();
      const Vector3d b = along.cross(a);
      landmark.estimate.sqrt_covariance.setZero();
      landmark.estimate.sqrt_covariance.col(0).head<3>() = 0.05 * a;
      landmark.estimate.sqrt_covariance.col(1).head<3>() = 0.05 * b;
      landmark.estimate.sqrt_covariance.col(2).tail<3>() = 0.05 * a;
      landmark.estimate.sqrt_covariance.col(3).tail<3>() = 0.05 * b;
      landmark.estimate.value = ends + landmark.estimate.sqrt_covariance * random.normals<4>(1.0);
      for (int k = 0; k < 5; ++k) {
        const Vector3d s = poses[k].inverse() * start;
        const Vector3d e = poses[k].inverse() * end;
        LineObservation observation;
        observation.left_start_px = camera.projectLeft(s) + noise();
        observation.left_end_px = camera.projectLeft(e) + noise();
        observation.right_start_px = camera.projectRight(s) + noise();
        observation.right_end_px = camera.projectRight(e) + noise();
        observation.sigma_px = kNoisePx;
        landmark.observations.push_back({k, observation});
      }
    }
  }

  double worstPose_m() const {
    double worst = 0.0;
    for (std::size_t k = 0; k < poses.size(); ++k) {
      worst = std::max(
          worst, (problem.frames[k].T_map_camera.translation() - poses[k].translation()).norm());
    }
    return worst;
  }
};

TEST(AdjustBundle, RecoversExactPosesPointsAndLines) {
  BundleWorld world(0.0, 60, 20);
  ASSERT_TRUE(adjustBundle(world.camera, {}, 50, &world.problem));
  EXPECT_LT(world.worstPose_m(), 1e-3);
  for (std::size_t i = 0; i < world.points.size(); ++i)
    EXPECT_LT((world.problem.points[i].estimate.value - world.points[i]).norm(), 0.02);
}

TEST(AdjustBundle, LinesAloneConstrainThePoses) {
  BundleWorld world(0.0, 0, 40);
  ASSERT_TRUE(adjustBundle(world.camera, {}, 50, &world.problem));
  EXPECT_LT(world.worstPose_m(), 2e-3);
}

TEST(AdjustBundle, NoiseAveragesOut) {
  BundleWorld world(kNoisePx, 100, 30);
  ASSERT_GT(world.worstPose_m(), 0.03);
  ASSERT_TRUE(adjustBundle(world.camera, {}, 50, &world.problem));
  EXPECT_LT(world.worstPose_m(), 0.006);
}

TEST(AdjustBundle, FixedFramesAreUnchanged) {
  BundleWorld world(kNoisePx, 60, 10);
  ASSERT_TRUE(adjustBundle(world.camera, {}, 10, &world.problem));
  for (int k = 0; k < 2; ++k)
    EXPECT_TRUE(world.problem.frames[k].T_map_camera.isApprox(world.poses[k], 0.0)) << k;
}

TEST(AdjustBundle, IsRobustToOutliers) {
  BundleWorld world(kNoisePx, 100, 0);
  for (int i = 0; i < 10; ++i)
    world.problem.points[i].observations[3].observation.left_px.x() += 40.0;
  ASSERT_TRUE(adjustBundle(world.camera, {}, 50, &world.problem));
  EXPECT_LT(world.worstPose_m(), 0.02);
}

/// Motion from one frame of the world to the next, as true, with a standard deviation [m, rad].
BundleProblem::Motion trueMotion(const BundleWorld& world, int from, double sigma) {
  return {from, from + 1, world.poses[from].inverse() * world.poses[from + 1],
          sigma * sigma * Matrix6d::Identity()};
}

TEST(AdjustBundle, MotionsConstrainWhatObservationsDoNot) {
  BundleWorld alone(kNoisePx, 4, 0);
  BundleWorld held(kNoisePx, 4, 0);
  for (int from = 1; from + 1 < static_cast<int>(held.poses.size()); ++from) {
    held.problem.motions.push_back(trueMotion(held, from, 1e-4));
  }
  ASSERT_TRUE(adjustBundle(alone.camera, {}, 50, &alone.problem));
  ASSERT_TRUE(adjustBundle(held.camera, {}, 50, &held.problem));
  EXPECT_GT(alone.worstPose_m(), 0.003);
  EXPECT_LT(held.worstPose_m(), 1e-3);
}

TEST(AdjustBundle, ObservationsOutweighUncertainMotions) {
  BundleWorld world(0.0, 60, 20);
  BundleProblem::Motion wrong = trueMotion(world, 2, 1.0);
  wrong.T_from_to = wrong.T_from_to * synthetic::transform({0.02, -0.03, 0.01}, {0.2, -0.1, 0.3});
  world.problem.motions.push_back(wrong);
  ASSERT_TRUE(adjustBundle(world.camera, {}, 50, &world.problem));
  EXPECT_LT(world.worstPose_m(), 1e-3);
}

TEST(AdjustBundle, MotionWithoutAUsableCovarianceIsLeftOut) {
  BundleWorld world(0.0, 60, 20);
  BundleProblem::Motion motion = trueMotion(world, 2, 0.0);
  motion.T_from_to.translation().x() += 1.0;
  world.problem.motions.push_back(motion);
  ASSERT_TRUE(adjustBundle(world.camera, {}, 50, &world.problem));
  EXPECT_LT(world.worstPose_m(), 1e-3);
}

/// What adjustBundle() returns, and that nothing is written to the log of the process.
bool adjustSilently(int max_iterations, BundleWorld* world) {
  testing::internal::CaptureStderr();
  const bool solved = adjustBundle(world->camera, {}, max_iterations, &world->problem);
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  return solved;
}

TEST(AdjustBundle, NothingToSolveChangesNothing) {
  BundleProblem empty;
  EXPECT_FALSE(adjustBundle(synthetic::camera(), {}, 5, &empty));
  BundleWorld broken(0.0, 20, 0);
  for (auto& landmark : broken.problem.points)
    landmark.observations[2].observation.left_px.x() = std::nan("");
  const Isometry3d before = broken.problem.frames[3].T_map_camera;
  EXPECT_FALSE(adjustSilently(5, &broken));
  EXPECT_TRUE(broken.problem.frames[3].T_map_camera.isApprox(before, 0.0));
}

TEST(AdjustBundle, APoseThatIsNotFiniteChangesNothing) {
  BundleWorld world(0.0, 20, 10);
  world.problem.motions.push_back(trueMotion(world, 2, 0.01));
  world.problem.frames[3].T_map_camera.translation().x() = std::nan("");
  const Isometry3d before = world.problem.frames[4].T_map_camera;
  EXPECT_FALSE(adjustSilently(5, &world));
  EXPECT_TRUE(world.problem.frames[4].T_map_camera.isApprox(before, 0.0));
}

/// Solves a world whose first landmarks are invalid: they are culled, the others are adjusted.
void expectFirstCulled(int num_points, int num_lines, BundleWorld* world) {
  ASSERT_TRUE(adjustSilently(50, world));
  EXPECT_LT(world->worstPose_m(), 0.006);
  for (std::size_t i = 0; i < world->points.size(); ++i) {
    const auto& landmark = world->problem.points[i];
    EXPECT_EQ(landmark.culled, static_cast<int>(i) < num_points) << i;
    if (landmark.culled) continue;
    EXPECT_LT((landmark.estimate.value - world->points[i]).norm(), 0.2) << i;
  }
  for (std::size_t i = 0; i < world->lines.size(); ++i)
    EXPECT_EQ(world->problem.lines[i].culled, static_cast<int>(i) < num_lines) << i;
}

TEST(AdjustBundle, LandmarksBehindACameraAreCulled) {
  BundleWorld world(kNoisePx, 100, 30);
  auto& point = world.problem.points[0].estimate.value;
  point = world.poses[3] * Vector3d(0.1, 0.2, -0.5);
  auto& ends = world.problem.lines[0].estimate.value;
  ends.tail<3>() = world.poses[3] * Vector3d(0.6, 0.1, -1.8);  // one end
  expectFirstCulled(1, 1, &world);
}

TEST(AdjustBundle, LandmarksThatAreNotFiniteAreCulled) {
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    BundleWorld world(kNoisePx, 100, 30);
    world.problem.points[0].estimate.value.setConstant(bad);
    world.problem.points[1].estimate.value.z() = bad;
    world.problem.points[2].estimate.sqrt_covariance(2, 2) = bad;
    world.problem.points[3].observations[1].observation.right_px.x() = bad;
    world.problem.lines[0].estimate.value.tail<3>().setConstant(bad);
    world.problem.lines[1].estimate.value(2) = bad;
    world.problem.lines[2].estimate.sqrt_covariance(1, 1) = bad;
    world.problem.lines[3].observations[4].observation.left_end_px.y() = bad;
    expectFirstCulled(4, 4, &world);
  }
}

TEST(AdjustBundle, LinesWithoutADirectionAreCulled) {
  BundleWorld world(kNoisePx, 100, 30);
  auto& short_line = world.problem.lines[0].estimate.value;
  short_line.tail<3>() = short_line.head<3>();
  const Isometry3d& T_map_camera = world.problem.frames[3].T_map_camera;
  world.problem.lines[1].estimate.value << T_map_camera * Vector3d(0.0, 0.0, 2.0),
      T_map_camera * Vector3d(0.0, 0.0, 5.0);  // on its axis: projects to a point
  expectFirstCulled(0, 2, &world);
}

/// A point at three times its depth: the first Gauss-Newton step would move it behind the cameras.
void placeFarBehind(int i, BundleWorld* world) {
  const Isometry3d& T_map_camera = world->poses[2];
  auto& estimate = world->problem.points[i].estimate;
  estimate.value = T_map_camera * (3.0 * (T_map_camera.inverse() * world->points[i]));
  estimate.sqrt_covariance = Matrix3d::Identity();
}

TEST(AdjustBundle, AStepBehindACameraIsMadeSmaller) {
  BundleWorld world(0.0, 60, 20);
  placeFarBehind(0, &world);
  ASSERT_TRUE(adjustSilently(50, &world));
  EXPECT_FALSE(world.problem.points[0].culled);
  const auto& estimate = world.problem.points[0].estimate;
  EXPECT_LT((estimate.value - world.points[0]).norm(), 0.05);
  EXPECT_LT(world.worstPose_m(), 1e-3);
}

/// The others take their step at once.
TEST(AdjustBundle, AStepBehindACameraDoesNotSpoilThatOfOthers) {
  BundleWorld world(0.0, 60, 20);
  const double before = world.worstPose_m();
  for (int i = 0; i < 3; ++i) placeFarBehind(i, &world);
  ASSERT_TRUE(adjustSilently(3, &world));
  EXPECT_LT(world.worstPose_m(), 0.2 * before);
}

// --- Local map

/// A point of the map at a position, which was always in view.
MapPoint mapPoint(std::uint64_t id, const Vector3d& estimate) {
  MapPoint point;
  point.id = id;
  point.estimate.value = estimate;
  point.estimate.sqrt_covariance = 2.0 * Matrix3d::Identity();
  return point;
}

/// A map with these points only.
LocalMap mapOf(std::vector<MapPoint> points) {
  LocalMap map;
  std::get<1>(map.state()) = std::move(points);
  return map;
}

TEST(LocalMap, RemovesLandmarksCulledByTheBundleAdjustment) {
  LocalMap map = mapOf({mapPoint(3, {0.0, 0.0, 4.0}), mapPoint(5, {1.0, 0.0, 4.0})});
  BundleProblem solved;
  for (const std::uint64_t id : {3, 5}) {
    solved.points.emplace_back();
    solved.points.back().id = id;
    solved.points.back().culled = id == 3;
  }
  solved.points[0].estimate.value.setConstant(std::nan(""));
  solved.points[1].estimate.value = {1.0, 0.0, 4.0};
  map.applyResult(solved);
  ASSERT_EQ(map.numPoints(), 1U);
  EXPECT_EQ(std::get<1>(map.state())[0].id, 5U);
}

/// Observed at a third of its depth: the linearised update moves it behind the camera.
TEST(LocalMap, ALandmarkMovedBehindTheCameraByItsUpdateIsCulled) {
  const StereoCamera camera = synthetic::camera();
  LocalMap map = mapOf({mapPoint(3, {0.0, 0.0, 6.0}), mapPoint(5, {0.5, 0.0, 6.0})});
  LandmarkMatches landmark_matches;
  landmark_matches.point_in_view = {true, true};
  const Vector3d seen[] = {{0.0, 0.0, 2.0}, {0.5, 0.0, 6.1}};
  for (const int i : {0, 1}) {
    PointObservation observation;
    observation.left_px = camera.projectLeft(seen[i]);
    observation.right_px = camera.projectRight(seen[i]);
    observation.sigma_px = kNoisePx;
    landmark_matches.points.push_back({i, observation});
  }
  MotionEstimate motion;
  motion.point_inliers = {true, true};
  const StereoImages images;
  const StereoCorrection correction;
  const Parameters parameters;
  const NoiseScale noise;
  map.add({}, {images, camera, correction, parameters, noise}, landmark_matches, motion, {});
  ASSERT_EQ(map.numPoints(), 1U);
  const MapPoint& kept = std::get<1>(map.state())[0];
  EXPECT_EQ(kept.id, 5U);
  EXPECT_LT((kept.estimate.value - seen[1]).norm(), 0.05);
}

/// A frame of noise with a stereo point at each pixel: point i is i + 1 metres away and has a
/// response of i.
StereoFrame frameOfPoints(const std::vector<Eigen::Vector2f>& pixels, int octave = 0) {
  const StereoCamera camera = synthetic::camera();
  cv::Mat image(camera.height, camera.width, CV_8UC1);
  cv::RNG(1).fill(image, cv::RNG::UNIFORM, 0, 256);
  StereoFrame frame;
  frame.left_image = ImagePyramid(image, PointParameters());
  for (const Eigen::Vector2f& pixel : pixels) {
    const auto index = static_cast<int>(frame.points.size());
    Keypoint feature;
    feature.pixel = pixel;
    feature.response = static_cast<float>(index);
    feature.octave = octave;
    frame.features.points_left.push_back(feature);
    frame.features.points_right.push_back(feature);
    StereoPoint point;
    point.left = point.right = index;
    point.sigma_px = kNoisePx;
    point.triangulated.p_camera.z() = index + 1.0;
    point.triangulated.covariance = 0.01 * Matrix3d::Identity();
    frame.points.push_back(point);
  }
  return frame;
}

/// The points of the map created by a first frame, by their indices in it.
/// \param share_of_new in the frame before it.
std::vector<int> indicesOfNewPoints(const StereoFrame& frame, const LandmarkCandidates& candidates,
                                    double share_of_new = 1.0) {
  LocalMap map;
  std::get<5>(map.state()) = share_of_new;
  const StereoImages images;
  const StereoCamera camera = synthetic::camera();
  const StereoCorrection correction;
  const Parameters parameters;
  map.add(frame, {images, camera, correction, parameters, {}}, {}, {}, candidates);
  std::vector<int> indices;
  for (const MapPoint& point : std::get<1>(map.state()))
    indices.push_back(static_cast<int>(std::lround(point.estimate.value.z())) - 1);
  return indices;
}

TEST(LocalMap, UnmatchedPointsFillBucketsWithRoom) {
  std::vector<Eigen::Vector2f> pixels;  // 20 in one cell, 2 in another
  for (int i = 0; i < 20; ++i) pixels.emplace_back(102 + 10 * (i % 5), 105 + 10 * (i / 5));
  pixels.emplace_back(310.0F, 210.0F);
  pixels.emplace_back(330.0F, 210.0F);
  const StereoFrame frame = frameOfPoints(pixels);
  const LandmarkCandidates few{{0, 1, 2, 3, 4}, {}, {5, 6, 7, 8, 9, 10, 11, 20, 21}};
  ASSERT_EQ(WindowParameters().points_per_cell, 8);
  // Inliers first, though they are the weakest; of either kind the strongest first.
  EXPECT_EQ(indicesOfNewPoints(frame, few), (std::vector<int>{4, 3, 2, 1, 0, 21, 20, 11, 10, 9}));
  const LandmarkCandidates many{{0, 1, 2, 3, 4, 5, 6, 7, 8}, {}, {9, 10, 20}};
  EXPECT_EQ(indicesOfNewPoints(frame, many), (std::vector<int>{8, 7, 6, 5, 4, 3, 2, 1, 20}));
  EXPECT_TRUE(indicesOfNewPoints(frame, {}).empty());
}

TEST(LocalMap, TheShareOfNewLandmarksLimitsUnmatchedPoints) {
  std::vector<Eigen::Vector2f> pixels;
  for (int i = 0; i < 15; ++i) pixels.emplace_back(102 + 10 * (i % 5), 105 + 10 * (i / 5));
  const StereoFrame frame = frameOfPoints(pixels);
  const LandmarkCandidates unmatched{{}, {}, {0, 1, 2, 3, 4, 5, 6, 7, 8, 9}};
  EXPECT_EQ(indicesOfNewPoints(frame, unmatched, 0.5), (std::vector<int>{9, 8, 7, 6}));
  EXPECT_EQ(indicesOfNewPoints(frame, unmatched, 0.0), (std::vector<int>{9, 8}));
  const LandmarkCandidates both{{10, 11, 12}, {}, {0, 1, 2, 3}};
  EXPECT_EQ(indicesOfNewPoints(frame, both, 0.5), (std::vector<int>{12, 11, 10, 3}));
  EXPECT_EQ(indicesOfNewPoints(frame, both, 0.0), (std::vector<int>{12, 11, 10}));
}

TEST(LocalMap, PatchesAreFromTheOctaveOfTheirPoint) {
  for (const int octave : {0, 1, 2}) {
    const StereoFrame empty = frameOfPoints({});
    const Eigen::Vector2f pixel = empty.left_image.fromLevel({60.0F, 50.0F}, octave);
    const StereoFrame frame = frameOfPoints({pixel}, octave);
    const MapPoint point =
        makePoint(frame, frame.points[0], synthetic::camera(), Isometry3d::Identity());
    EXPECT_EQ(point.octave, octave);
    const cv::Mat& level = frame.left_image.levels[static_cast<std::size_t>(octave)];
    constexpr int kSide = MapPoint::kPatchSide;
    for (int y = 0; y < kSide; ++y) {
      for (int x = 0; x < kSide; ++x) {
        EXPECT_EQ(point.patch[static_cast<std::size_t>(y * kSide + x)],
                  level.at<uchar>(50 + y - kSide / 2, 60 + x - kSide / 2));
      }
    }
  }
}

// --- limitedStep()

Matrix6d sigmas(double sigma_m, double sigma_rad) {
  Vector6d variances;
  variances << Vector3d::Constant(sigma_m * sigma_m), Vector3d::Constant(sigma_rad * sigma_rad);
  return variances.asDiagonal();
}

TEST(LimitedStep, AppliesASmallCorrectionAtOnce) {
  const Isometry3d measured = synthetic::transform({0.0, 0.1, 0.0}, {0.0, 0.0, 1.0});
  const Isometry3d wanted = measured * synthetic::transform({0.0, 0.0, 0.001}, {0.01, 0.0, 0.0});
  EXPECT_TRUE(limitedStep(measured, wanted, sigmas(0.01, 0.001), 3.0).isApprox(wanted, 1e-9));
}

TEST(LimitedStep, LimitsALargeCorrection) {
  const Isometry3d measured = synthetic::transform({0.0, 0.1, 0.0}, {0.0, 0.0, 1.0});
  const Isometry3d wanted = measured * synthetic::transform(Vector3d::Zero(), {0.5, 0.0, 0.0});
  const Isometry3d step = limitedStep(measured, wanted, sigmas(0.01, 0.001), 3.0);
  EXPECT_NEAR((measured.inverse() * step).translation().norm(), 0.03, 1e-9);
}

// --- The odometry with and without landmarks: the tiled room

using synthetic::frame;
using synthetic::kFrames;
using synthetic::kPeriodNs;
using synthetic::stamped;

TEST(MapOdometry, LandmarksAreTrackedAndBounded) {
  Parameters parameters = synthetic::roomParameters();
  parameters.window.size = 2;
  parameters.local_map.size = 1;
  StereoOdometry odometry(synthetic::roomCamera(), parameters);
  FrameResult result;
  for (int k = 0; k < kFrames; ++k) {
    result = odometry.process(frame(k));
    EXPECT_LE(result.counts.keyframes, 3);
  }
  EXPECT_GT(result.counts.map_point_inliers, 20);
  EXPECT_GT(result.counts.map_points, result.counts.map_point_inliers);
}

TEST(MapOdometry, WindowZeroHasNoLandmarks) {
  Parameters parameters = synthetic::roomParameters();
  parameters.window.size = 0;
  StereoOdometry odometry(synthetic::roomCamera(), parameters);
  for (int k = 0; k < kFrames; ++k) {
    const FrameResult result = odometry.process(frame(k));
    EXPECT_EQ(result.counts.map_points + result.counts.map_lines + result.counts.keyframes, 0);
  }
}

TEST(MapOdometry, OneThreadAndTwoGiveTheSameBits) {
  Parameters parameters = synthetic::roomParameters();
  parameters.tracking.threads = 1;
  StereoOdometry one(synthetic::roomCamera(), parameters);
  parameters.tracking.threads = 2;
  StereoOdometry two(synthetic::roomCamera(), parameters);
  for (int k = 0; k < kFrames; ++k) {
    const FrameResult a = one.process(frame(k));
    const FrameResult b = two.process(frame(k));
    EXPECT_EQ(a.T_odom_camera.matrix(), b.T_odom_camera.matrix()) << k;
    EXPECT_EQ(a.pose_covariance, b.pose_covariance) << k;
  }
}

/// The same image with independent sensor noise: the pose must not drift.
TEST(MapOdometry, NoDriftAtStandstill) {
  StereoOdometry odometry(synthetic::roomCamera(), synthetic::roomParameters());
  synthetic::Random random(1);
  const StereoImages still = frame(0);
  FrameResult result;
  for (int k = 0; k < 120; ++k) {
    StereoImages noisy{still.left.clone(), still.right.clone(), (k + 1) * kPeriodNs};
    for (cv::Mat* image : {&noisy.left, &noisy.right}) {
      for (int y = 0; y < image->rows; ++y) {
        for (int x = 0; x < image->cols; ++x) {
          uchar& pixel = image->at<uchar>(y, x);
          pixel = cv::saturate_cast<uchar>(pixel + random.normal(1.5));
        }
      }
    }
    result = odometry.process(noisy);
    ASSERT_EQ(result.state, k == 0 ? TrackingState::kInitializing : TrackingState::kOk) << k;
  }
  EXPECT_LT(result.T_odom_camera.translation().norm(), 0.001);
  EXPECT_LT(logSO3(result.T_odom_camera.linear()).norm() * 180.0 / M_PI, 0.01);
  EXPECT_LE(result.counts.keyframes, 3);
}

/// The right camera is pitched down by 0.1 deg against its calibration: that is estimated and
/// corrected.
TEST(MapOdometry, APitchOfTheRightCameraIsEstimated) {
  const StereoCamera camera = synthetic::roomCamera();
  const double shift_px = camera.fy * 0.1 * M_PI / 180.0;
  StereoOdometry odometry(camera, synthetic::roomParameters());
  FrameResult result;
  for (int k = 0; k < kFrames; ++k) {
    StereoImages images = frame(k);
    const cv::Matx23d down(1.0, 0.0, 0.0, 0.0, 1.0, shift_px);
    cv::warpAffine(images.right.clone(), images.right, down, images.right.size(), cv::INTER_CUBIC,
                   cv::BORDER_REPLICATE);
    result = odometry.process(images);
    EXPECT_EQ(result.state, k == 0 ? TrackingState::kInitializing : TrackingState::kOk) << k;
  }
  EXPECT_NEAR(odometry.correction().v(0), shift_px, 0.15 * shift_px);
  const Isometry3d ground_truth = synthetic::truePose(kFrames - 1);
  EXPECT_LT((result.T_odom_camera.translation() - ground_truth.translation()).norm(), 0.03);
}

/// After a gap the camera is relocalized in the map if it observes it; where it sees another place,
/// a new map is started.
TEST(MapOdometry, AGapStartsANewMapUnlessThePlaceIsTheSame) {
  for (const bool sees_it : {true, false}) {
    StereoOdometry odometry(synthetic::roomCamera(), synthetic::roomParameters());
    for (int k = 0; k < 4; ++k) odometry.process(frame(k));
    const auto later = [&](int k) {
      StereoImages images = stamped(frame(k), k * kPeriodNs + 1100000000);
      if (!sees_it) {
        cv::flip(images.left.clone(), images.left, 0);
        cv::flip(images.right.clone(), images.right, 0);
      }
      return images;
    };
    const FrameResult found = odometry.process(later(4));
    EXPECT_EQ(found.reason, sees_it ? TrackingReason::kNone : TrackingReason::kFrameGap);
    EXPECT_EQ(found.counts.relocalizations, sees_it ? 1 : 0);
    const FrameResult next = odometry.process(later(5));
    EXPECT_EQ(next.counts.map_points > 0, sees_it);
    EXPECT_EQ(next.state, TrackingState::kOk);
  }
}

}  // namespace
}  // namespace point_line_odometry
