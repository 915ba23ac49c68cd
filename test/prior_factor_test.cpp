/// The relative-pose factor of a motion prior: its derivatives, its distance, and what it adds to
/// an estimate.

#include "motion/prior_factor.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>

#include "geometry/se3.h"
#include "motion/motion_estimator.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

/// Knows the rotation to `sigma_rad`.
MotionPrior rotationPrior(const Isometry3d& T_curr_prev, double sigma_rad) {
  MotionPrior prior;
  prior.T_prev_curr.linear() = T_curr_prev.linear().transpose();
  prior.information.diagonal().tail<3>().setConstant(1.0 / (sigma_rad * sigma_rad));
  return prior;
}

MotionPrior fullPrior(const Isometry3d& T_curr_prev, double sigma_m, double sigma_rad) {
  MotionPrior prior = rotationPrior(T_curr_prev, sigma_rad);
  prior.T_prev_curr = T_curr_prev.inverse();
  prior.information.diagonal().head<3>().setConstant(1.0 / (sigma_m * sigma_m));
  return prior;
}

TEST(PriorFactor, HasTheDerivativesOfItsResidual) {
  const MotionPrior prior = fullPrior(synthetic::motion(), 0.1, 0.05);
  const PriorFactor factor(prior);
  EXPECT_EQ(factor.axes(), 6);
  for (const double scale : {0.2, 6.0}) {
    const Isometry3d T = synthetic::transform(scale * Vector3d(0.02, -0.03, 0.05),
                                              scale * Vector3d(-0.05, 0.03, 0.1)) *
                         synthetic::motion();
    const auto moved = [&](const Vector6d& by) {
      Isometry3d T_moved = T;
      T_moved.linear() = expSO3(by.head<3>()) * T.linear();
      T_moved.translation() += by.tail<3>();
      return factor.linearize(T_moved).residual;
    };
    const PriorFactor::Linearization at = factor.linearize(T);
    constexpr double kStep = 1e-6;
    for (int i = 0; i < 6; ++i) {
      const Vector6d step = kStep * Vector6d::Unit(i);
      const Vector6d numeric = (moved(step) - moved(-step)) / (2.0 * kStep);
      EXPECT_TRUE(at.jacobian.col(i).isApprox(numeric, 1e-5)) << i << " at " << scale;
    }
  }
}

TEST(PriorFactor, PullsNoMoreThanItSays) {
  const PriorFactor factor(fullPrior(synthetic::motion(), 0.1, 0.05));
  for (const double metres : {0.1, 1.0, 10.0, 1000.0}) {
    const Isometry3d T = synthetic::transform({}, {metres, 0.0, 0.0}) * synthetic::motion();
    const PriorFactor::Linearization at = factor.linearize(T);
    const double pull = at.loss.weight * (at.jacobian.transpose() * at.residual).tail<3>().norm();
    EXPECT_LE(pull, metres / 0.01 * (1.0 + 1e-9));
    EXPECT_LE(pull, 3.0 / 0.1 * (1.0 + 1e-9)) << "Huber's loss bounds it";
  }
}

TEST(PriorFactor, DistanceIgnoresUnknownAxes) {
  const MotionPrior prior = rotationPrior(synthetic::motion(), 0.01);
  const PriorFactor factor(prior);
  EXPECT_EQ(factor.axes(), 3);
  Matrix6d covariance = Matrix6d::Zero();
  covariance.diagonal().setConstant(1e-6);
  EXPECT_NEAR(factor.chiSquare(synthetic::motion(), covariance), 0.0, 1e-9);
  Isometry3d turned = synthetic::motion();
  turned.linear() = turned.linear() * expSO3({0.02, 0.0, 0.0});
  turned.translation() += Vector3d(5.0, 5.0, 5.0);
  EXPECT_NEAR(factor.chiSquare(turned, covariance), 0.02 * 0.02 / (1e-4 + 1e-6), 1e-6);
  PriorReport report{PriorUse::kUsed, 21.0, 3};
  EXPECT_TRUE(PriorFactor::agrees(report));
  report.chi_square = 21.2;
  EXPECT_FALSE(PriorFactor::agrees(report));
  report.chi_square = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(PriorFactor::agrees(report));
}

TEST(MotionPrior, WhatIsNoPriorIsNotUsable) {
  const MotionPrior good = fullPrior(synthetic::motion(), 0.1, 0.01);
  EXPECT_TRUE(isUsable(good));
  EXPECT_TRUE(isUsable(rotationPrior(synthetic::motion(), 1e-5)));
  MotionPrior prior = good;
  prior.T_prev_curr.translation().x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(isUsable(prior));
  prior = good;
  prior.T_prev_curr.linear() *= 1.1;
  EXPECT_FALSE(isUsable(prior));
  prior = good;
  prior.information(0, 1) = 50.0;
  EXPECT_FALSE(isUsable(prior)) << "not symmetric";
  prior = good;
  prior.information(5, 5) = -1e4;
  EXPECT_FALSE(isUsable(prior)) << "not positive";
}

TEST(MotionPrior, ComposedKnowsWhatBothKnow) {
  const Isometry3d T_1 = synthetic::motion();
  const Isometry3d T_2 = synthetic::transform({-0.1, 0.2, 0.0}, {0.0, 0.1, -0.5});
  MotionPrior first = fullPrior(T_1, 0.1, 0.01);
  MotionPrior second = fullPrior(T_2, 0.1, 0.01);
  first.from_ns = 10;
  first.to_ns = second.from_ns = 20;
  second.to_ns = 30;
  const MotionPrior both = composed(first, second);
  EXPECT_EQ(both.from_ns, 10);
  EXPECT_EQ(both.to_ns, 30);
  EXPECT_TRUE(both.T_prev_curr.isApprox((T_2 * T_1).inverse(), 1e-12));
  const Matrix6d covariance = both.information.inverse();
  EXPECT_NEAR(covariance(3, 3), 4e-4, 1e-5);
  EXPECT_GT(covariance(0, 0), 0.04 - 1e-4);
  const MotionPrior half = composed(rotationPrior(T_1, 0.01), second);
  EXPECT_TRUE(isUsable(half));
  EXPECT_EQ(PriorFactor(half).axes(), 3);
}

/// As by a gyroscope's bias: not the variances add up but the deviations.
TEST(MotionPrior, ErrorsOfComposedOnesMayBeTheSame) {
  MotionPrior sum = fullPrior(Isometry3d::Identity(), 0.1, 0.01);
  for (int n = 2; n <= 10; ++n) {
    sum = composed(sum, fullPrior(Isometry3d::Identity(), 0.1, 0.01));
    const Matrix6d covariance = sum.information.inverse();
    EXPECT_NEAR(covariance(0, 0), std::pow(0.1 * n, 2), 1e-4 * n * n) << n;
    EXPECT_NEAR(covariance(5, 5), std::pow(0.01 * n, 2), 1e-6 * n * n) << n;
  }
}

TEST(MotionPrior, FusedCovarianceIsThatOfIndependentInformation) {
  Matrix6d root = Matrix6d::Identity();
  for (int i = 0; i < 36; ++i) root(i / 6, i % 6) += 0.1 * std::sin(7.0 * i);
  const Matrix6d covariance = root * root.transpose();
  const Matrix6d information = 30.0 * covariance.inverse();
  EXPECT_TRUE(fusedCovariance(covariance, information).isApprox(covariance / 31.0, 1e-9));
  EXPECT_TRUE(fusedCovariance(covariance, Matrix6d::Zero()).isApprox(covariance, 1e-12));
}

/// With few matches a prior of the rotation takes the part of the error that it can; the covariance
/// says so.
TEST(EstimateWithPrior, ImprovesAnEstimateByWhatItKnows) {
  synthetic::MatchOptions options;
  options.points = 10;
  options.lines = 0;
  options.noise_px = 0.5;
  const StereoCamera camera = synthetic::camera();
  double images_error = 0.0;
  double prior_error = 0.0;
  int solved = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const Correspondences some = synthetic::matches(camera, synthetic::motion(), options, seed);
    const MotionEstimate images = estimateMotion(some, camera, Isometry3d::Identity(), {});
    if (!images.ok()) continue;
    const PriorFactor factor(rotationPrior(synthetic::motion(), 1e-4));
    const auto with_prior =
        estimateWithPrior(images, {factor, images.T_curr_prev}, some, camera, {});
    ASSERT_TRUE(with_prior.has_value());
    const MotionEstimate& fused = *with_prior;
    const auto error = [](const MotionEstimate& estimate) {
      return rotationAngle(estimate.T_curr_prev.linear() *
                           synthetic::motion().linear().transpose());
    };
    images_error += error(images);
    prior_error += error(fused);
    ++solved;
    EXPECT_LT(fused.covariance.diagonal().tail<3>().maxCoeff(), 1.01e-8);
    EXPECT_LE(fused.covariance.trace(), images.covariance.trace() * 1.5);
  }
  EXPECT_GT(solved, 15);
  EXPECT_LT(prior_error, 0.3 * images_error);
}

/// Inliers may be fewer than the matches from which a motion is looked for.
TEST(EstimateWithPrior, TakesAsFewInliersAsTheImagesAlone) {
  synthetic::MatchOptions options;
  options.points = 8;
  options.lines = 0;
  options.noise_px = 0.3;
  options.outlier_share = 0.12;  // the first one
  const StereoCamera camera = synthetic::camera();
  const PriorFactor factor(rotationPrior(synthetic::motion(), 1e-4));
  int fewer = 0;
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const Correspondences some = synthetic::matches(camera, synthetic::motion(), options, seed);
    const MotionEstimate images = estimateMotion(some, camera, synthetic::motion(), {});
    if (!images.ok() || images.num_point_inliers >= MotionParameters().min_matches) continue;
    ++fewer;
    const auto fused = estimateWithPrior(images, {factor, images.T_curr_prev}, some, camera, {});
    ASSERT_TRUE(fused.has_value()) << seed;
    EXPECT_LT(rotationAngle(fused->T_curr_prev.linear() * synthetic::motion().linear().transpose()),
              1e-3)
        << seed;
  }
  EXPECT_GT(fewer, 5);
}

}  // namespace
}  // namespace point_line_odometry
