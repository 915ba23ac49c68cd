#include "motion/landmark_refinement.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <limits>
#include <string>
#include <vector>

#include "geometry/triangulation.h"
#include "motion/residuals.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr auto kBoth = ResidualImages::kBoth;

// So much that most landmarks of noisyPoints() are refined.
constexpr double kNoisyPx = 1.5;

const StereoCamera& camera() {
  static const StereoCamera camera = synthetic::camera();
  return camera;
}

Vector3d residualOf(const PointCorrespondence& match) {
  return PointResidual<kBoth>(match, camera(), synthetic::motion()).value;
}

PointCorrespondence refinedOf(const PointCorrespondence& match) {
  return withRefinedLandmark<kBoth>(match, camera(), synthetic::motion());
}

/// Of synthetic::matches(), with noise.
std::vector<PointCorrespondence> noisyPoints(double noise_px) {
  synthetic::MatchOptions options{100, 0};
  options.noise_px = options.sigma_px = noise_px;
  return synthetic::matches(camera(), synthetic::motion(), options, 1).points;
}

/// Pixel in the left image, and disparity [px].
Vector3d pixelsOf(const Vector3d& p) {
  const Eigen::Vector2d left = camera().projectLeft(p);
  return {left.x(), left.y(), left.x() - camera().projectRight(p).x()};
}

/// Squared Mahalanobis distance of a landmark from its observations in both frames.
double distanceOf(const Vector3d& p, const PointCorrespondence& observed) {
  const double disparity_px = pixelsOf(observed.p_prev).z();
  const Matrix3d by_point =
      backProjectionJacobian(camera(), observed.p_prev, disparity_px).inverse();
  const Matrix3d covariance = by_point * observed.covariance * by_point.transpose();
  const Vector3d in_prev = pixelsOf(p) - pixelsOf(observed.p_prev);
  PointCorrespondence moved = observed;
  moved.p_prev = p;
  return in_prev.dot(covariance.inverse() * in_prev) +
         residualOf(moved).squaredNorm() / (observed.sigma_px * observed.sigma_px);
}

TEST(LandmarkRefinement, TheLandmarkIsTheMostProbableOne) {
  int moved = 0;
  for (const PointCorrespondence& match : noisyPoints(kNoisyPx)) {
    const Vector3d p = refinedOf(match).p_prev;
    if (p == match.p_prev) continue;
    ++moved;
    const double refined = distanceOf(p, match);
    EXPECT_LT(refined, distanceOf(match.p_prev, match));
    if (refined > 4.0) continue;  // those of large residuals are moved less
    const double step = 0.02 * p.norm();
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_LT(refined, distanceOf(p + step * Vector3d::Unit(axis), match));
      EXPECT_LT(refined, distanceOf(p - step * Vector3d::Unit(axis), match));
    }
  }
  EXPECT_GT(moved, 50);
}

TEST(LandmarkRefinement, TheResidualIsTheSameToFirstOrder) {
  const std::vector<PointCorrespondence> matches = noisyPoints(kNoisyPx);
  const auto largestChange = [&](double share) {
    double largest = 0.0;
    for (PointCorrespondence match : matches) {
      const Vector3d p = synthetic::motion() * match.p_prev;
      match.left_px = camera().projectLeft(p) + share * (match.left_px - camera().projectLeft(p));
      match.right_px =
          camera().projectRight(p) + share * (match.right_px - camera().projectRight(p));
      largest = std::max(largest, (residualOf(refinedOf(match)) - residualOf(match)).norm());
    }
    return largest;
  };
  EXPECT_LT(largestChange(0.1), 0.02);
  EXPECT_NEAR(largestChange(0.1) / largestChange(0.05), 4.0, 0.5) << "it is of second order";
}

TEST(LandmarkRefinement, TheCovarianceMovesWithTheLandmark) {
  for (const PointCorrespondence& match : noisyPoints(kNoisyPx)) {
    const PointCorrespondence refined = refinedOf(match);
    const Vector3d pixels = pixelsOf(refined.p_prev);
    const auto triangulated =
        triangulatePoint(camera(), pixels.head<2>(), pixels.x() - pixels.z(), match.sigma_px, 0.1);
    ASSERT_TRUE(triangulated);
    EXPECT_TRUE(refined.covariance.isApprox(triangulated->covariance, 1e-9));
  }
}

TEST(LandmarkRefinement, WithoutNoiseNothingChanges) {
  PointCorrespondence match = noisyPoints(kNoisyPx).front();
  match.left_px = camera().projectLeft(synthetic::motion() * match.p_prev);
  match.right_px = camera().projectRight(synthetic::motion() * match.p_prev);
  const PointCorrespondence refined = refinedOf(match);
  EXPECT_TRUE(refined.p_prev.isApprox(match.p_prev, 1e-9));
  EXPECT_LT(refined.offset_px.norm(), 1e-9);
}

TEST(LandmarkRefinement, WhatCannotBeRefinedStaysAsItIs) {
  const PointCorrespondence given = noisyPoints(kNoisyPx).front();
  const auto expectTheSame = [](const PointCorrespondence& match, const std::string& what) {
    const PointCorrespondence refined = refinedOf(match);
    EXPECT_EQ(refined.p_prev, match.p_prev) << what;
    EXPECT_EQ(refined.covariance, match.covariance) << what;
    EXPECT_EQ(refined.offset_px, Vector3d::Zero()) << what;
  };
  ASSERT_NE(refinedOf(given).p_prev, given.p_prev);
  const PointCorrespondence exact = noisyPoints(0.1).front();
  expectTheSame(exact, "exact");
  PointCorrespondence far = given;
  far.far = true;
  expectTheSame(far, "far");
  PointCorrespondence behind = given;
  behind.p_prev.z() = -3.0;
  expectTheSame(behind, "behind the camera");
  // Half a pixel away from infinity, and two pixels by the current frame.
  constexpr double kFewPx = 0.5;
  const Eigen::Vector2d pixel(300.0, 200.0);
  PointCorrespondence vague = given;
  const auto triangulated = triangulatePoint(camera(), pixel, pixel.x() - kFewPx, 0.5, 0.1);
  vague.p_prev = triangulated.value().p_camera;
  vague.covariance = triangulated->covariance;
  vague.left_px = camera().projectLeft(synthetic::motion() * vague.p_prev);
  vague.right_px = vague.left_px - Eigen::Vector2d(4.0 * kFewPx, 0.0);
  vague.sigma_px = 0.1;
  expectTheSame(vague, "another disparity");
  PointCorrespondence invalid = given;
  invalid.left_px.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(refinedOf(invalid).p_prev, given.p_prev);
}

}  // namespace
}  // namespace point_line_odometry
