#include "odometry/uncertainty.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "point_line_odometry/motion.h"
#include "point_line_odometry/pose_integrator.h"
#include "point_line_odometry/triangulation.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

Matrix6d someCovariance(unsigned seed, double scale) {
  synthetic::Random random(seed);
  Matrix6d A;
  for (int i = 0; i < 36; ++i) A(i / 6, i % 6) = random.uniform(-1.0, 1.0);
  return scale * scale * (A * A.transpose() + Matrix6d::Identity());
}

Vector6d sample(const Matrix6d& covariance, synthetic::Random* random) {
  Vector6d white;
  for (int i = 0; i < 6; ++i) white(i) = random->normal(1.0);
  return Eigen::LLT<Matrix6d>(covariance).matrixL() * white;
}

TEST(ComposeCovariance, NoUncertaintyStaysNone) {
  const Isometry3d T = synthetic::motion();
  EXPECT_EQ(composeCovariance(T, Matrix6d::Zero(), T, Matrix6d::Zero()), Matrix6d::Zero());
}

TEST(ComposeCovariance, StandingStillKeepsIt) {
  const Matrix6d covariance = someCovariance(1, 0.1);
  const Matrix6d same =
      composeCovariance(synthetic::motion(), covariance, Isometry3d::Identity(), Matrix6d::Zero());
  EXPECT_LT((same - covariance).norm(), 1e-12);
}

TEST(ComposeCovariance, HeadingErrorActsAtTheLeversEnd) {
  // 0.1 rad about y over 10 m forward: 1 m to the side, and forward nothing.
  Matrix6d pose = Matrix6d::Zero();
  pose(4, 4) = 0.01;
  const Isometry3d forward = synthetic::transform(Vector3d::Zero(), {0.0, 0.0, 10.0});
  const Matrix6d covariance =
      composeCovariance(Isometry3d::Identity(), pose, forward, Matrix6d::Zero());
  EXPECT_NEAR(covariance(0, 0), 1.0, 1e-12);
  EXPECT_NEAR(covariance(1, 1), 0.0, 1e-12);
  EXPECT_NEAR(covariance(2, 2), 0.0, 1e-12);
  EXPECT_NEAR(covariance(0, 4), 0.1, 1e-12);  // turned to +x, the camera ends at +x
}

TEST(ComposeCovariance, MotionNoiseIsTurnedIntoOdom) {
  // A camera that looks along odom's x: its z noise is odom's x noise.
  Matrix6d motion = Matrix6d::Zero();
  motion(2, 2) = 0.04;
  motion(5, 5) = 0.09;
  const Isometry3d T = synthetic::transform({0.0, M_PI / 2.0, 0.0}, {3.0, 2.0, 1.0});
  const Matrix6d covariance =
      composeCovariance(T, Matrix6d::Zero(), Isometry3d::Identity(), motion);
  EXPECT_NEAR(covariance(0, 0), 0.04, 1e-12);
  EXPECT_NEAR(covariance(3, 3), 0.09, 1e-12);
  EXPECT_NEAR(covariance.trace(), 0.13, 1e-12);
}

TEST(ComposeCovariance, AgreesWithMonteCarlo) {
  const Isometry3d T_odom_prev = synthetic::transform({0.4, -0.9, 0.3}, {1.0, 2.0, 3.0});
  const Isometry3d T_prev_curr = synthetic::transform({-0.2, 0.1, 0.5}, {0.5, -0.3, 2.0});
  const Matrix6d pose = someCovariance(2, 0.004);
  const Matrix6d motion = someCovariance(3, 0.005);
  const Matrix6d expected = composeCovariance(T_odom_prev, pose, T_prev_curr, motion);
  const Isometry3d T_odom_curr = T_odom_prev * T_prev_curr;
  synthetic::Random random(4);
  Matrix6d sampled = Matrix6d::Zero();
  constexpr int kSamples = 20000;
  // Errors are additive for positions and left rotations about the frame's axes: (t + dt, exp(dr)
  // R).
  const auto disturbed = [](const Isometry3d& T, const Vector6d& error) {
    Isometry3d moved = T;
    moved.translation() += error.head<3>();
    moved.linear() = synthetic::transform(error.tail<3>(), Vector3d::Zero()).linear() * T.linear();
    return moved;
  };
  for (int i = 0; i < kSamples; ++i) {
    const Isometry3d T = disturbed(T_odom_prev, sample(pose, &random)) *
                         disturbed(T_prev_curr, sample(motion, &random));
    Vector6d error;
    error.head<3>() = T.translation() - T_odom_curr.translation();
    error.tail<3>() = synthetic::logarithm(T.linear() * T_odom_curr.linear().transpose());
    sampled += error * error.transpose() / kSamples;
  }
  for (int r = 0; r < 6; ++r) {
    for (int c = 0; c < 6; ++c) {
      EXPECT_NEAR(sampled(r, c), expected(r, c), 0.05 * std::sqrt(expected(r, r) * expected(c, c)))
          << r << ' ' << c;
    }
  }
}

TEST(ComposeCovariance, StaysSymmetricAndPositiveOverManySteps) {
  Isometry3d T = Isometry3d::Identity();
  Matrix6d covariance = Matrix6d::Zero();
  const Isometry3d step = synthetic::motion().inverse();
  for (int i = 0; i < 2000; ++i) {
    covariance = composeCovariance(T, covariance, step, someCovariance(5, 0.001));
    T = T * step;
  }
  EXPECT_EQ(covariance, Matrix6d(covariance.transpose()));
  EXPECT_GT(Eigen::SelfAdjointEigenSolver<Matrix6d>(covariance).eigenvalues().minCoeff(), 0.0);
}

TEST(Velocity, HandNumbers) {
  Vector6d velocity;
  velocity << 1.0, 2.0, 3.0, 0.0, 0.0, 0.0;
  const Isometry3d T = motionAtVelocity(velocity, 0.5);
  EXPECT_LT((T.translation() - Vector3d(0.5, 1.0, 1.5)).norm(), 1e-12);
  EXPECT_EQ(T.linear(), Eigen::Matrix3d::Identity());
}

TEST(Velocity, TurningLeadsAlongAnArc) {
  // Forward at 1 m/s while turning left by 90 deg in a second: the chord points 45 deg to the left.
  Vector6d velocity;
  velocity << 0.0, 0.0, 1.0, 0.0, -M_PI / 2.0, 0.0;
  const Isometry3d T = motionAtVelocity(velocity, 1.0);
  EXPECT_LT((T.translation() - Vector3d(-std::sqrt(0.5), 0.0, std::sqrt(0.5))).norm(), 1e-12);
  EXPECT_LT((T.linear() * Vector3d::UnitZ() - Vector3d(-1.0, 0.0, 0.0)).norm(), 1e-12);
}

TEST(Velocity, MotionAndVelocityAreInverse) {
  for (const double dt_s : {0.01, 0.1, 1.7}) {
    for (const Vector3d& rotation :
         {Vector3d(0.0, 0.0, 0.0), Vector3d(1e-9, 0.0, 0.0), Vector3d(0.3, -1.0, 2.0)}) {
      const Isometry3d T = synthetic::transform(rotation, {0.5, -0.2, 3.0});
      EXPECT_TRUE(motionAtVelocity(velocityOfMotion(T, dt_s), dt_s).isApprox(T, 1e-12)) << dt_s;
    }
  }
}

TEST(PredictionCovariance, GrowsWithTheTimeUnmeasured) {
  const Vector6d velocity = Vector6d::Constant(0.5);
  double last = 0.0;
  for (const double unmeasured_s : {0.1, 0.2, 0.4, 0.8}) {
    const Matrix6d covariance = predictionCovariance(velocity, true, 0.1, unmeasured_s);
    EXPECT_GT(covariance(0, 0), 2.0 * last);
    EXPECT_GT(covariance(3, 3), 0.0);
    EXPECT_TRUE(covariance.isDiagonal());
    last = covariance(0, 0);
  }
}

TEST(PredictionCovariance, UnknownSpeedMustAllowForGoingOn) {
  Vector6d velocity = Vector6d::Zero();
  velocity(2) = 10.0;
  const Matrix6d known = predictionCovariance(velocity, true, 0.1, 0.1);
  const Matrix6d unknown = predictionCovariance(velocity, false, 0.1, 0.1);
  EXPECT_GE(std::sqrt(unknown(2, 2)), 1.0);  // 10 m/s for 0.1 s
  EXPECT_LT(std::sqrt(known(2, 2)), 0.5);
}

// --- Covariance of the estimated motion

/// Error of T_prev_curr in the terms of MotionEstimate::covariance.
Vector6d errorOf(const MotionEstimate& estimate, const Isometry3d& T_curr_prev) {
  const Isometry3d found = estimate.T_curr_prev.inverse();
  const Isometry3d truth = T_curr_prev.inverse();
  Vector6d error;
  error.head<3>() = found.translation() - truth.translation();
  error.tail<3>() = synthetic::logarithm(found.linear() * truth.linear().transpose());
  return error;
}

struct NoiseCase {
  int points;
  int lines;
  const char* images;
};

class NoisyMotionTest : public ::testing::TestWithParam<NoiseCase> {};

TEST_P(NoisyMotionTest, ErrorAgreesWithTheCovariance) {
  constexpr int kSeeds = 150;
  MotionParameters parameters;
  parameters.residual_images = GetParam().images;
  synthetic::MatchOptions options{GetParam().points, GetParam().lines};
  options.noise_px = options.sigma_px = 0.3;
  // So large a motion that the axes of the two cameras are not mixed up unnoticed.
  const Isometry3d truth = synthetic::transform({0.1, -0.15, 1.0}, {0.3, -0.2, 0.8});
  const Isometry3d start = synthetic::transform({0.1, -0.12, 0.9}, {0.0, 0.0, 0.6});
  double nees = 0.0;
  int beyond = 0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const Correspondences noisy = synthetic::matches(synthetic::camera(), truth, options, seed);
    const MotionEstimate estimate = estimateMotion(noisy, synthetic::camera(), start, parameters);
    ASSERT_TRUE(estimate.ok());
    const Vector6d error = errorOf(estimate, truth);
    nees += error.dot(estimate.covariance.inverse() * error) / kSeeds;
    for (int i = 0; i < 6; ++i) {
      const double sigmas = std::abs(error(i)) / std::sqrt(estimate.covariance(i, i));
      EXPECT_LT(sigmas, 4.5) << "seed " << seed << " axis " << i;
      beyond += sigmas > 3.5 ? 1 : 0;
    }
    EXPECT_LT(std::sqrt(estimate.covariance(2, 2)), 0.05);
  }
  // 6 for exact covariances.
  RecordProperty("nees", std::to_string(nees));
  EXPECT_LE(beyond, 3) << "of 900 errors beyond 3.5 sigma";
  EXPECT_GT(nees, 4.0);
  EXPECT_LT(nees, 8.0);
}

INSTANTIATE_TEST_SUITE_P(Kinds, NoisyMotionTest,
                         ::testing::Values(NoiseCase{60, 0, "both"}, NoiseCase{0, 60, "both"},
                                           NoiseCase{40, 30, "both"}, NoiseCase{40, 30, "left"}));

TEST(EstimateMotion, CovarianceHoldsFarFromTheOrigin) {
  // The place of the camera is known well though its lever to the origin is long: rotation and
  // translation of T_curr_prev are correlated, and must be so with the right sign.
  const StereoCamera camera = synthetic::camera();
  const Isometry3d truth = synthetic::transform({0.3, -0.4, 0.9}, {30.0, 20.0, -40.0});
  MotionParameters parameters;
  parameters.use_triangulation_covariance = false;
  constexpr int kSeeds = 100;
  double nees = 0.0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    synthetic::Random random(seed);
    Correspondences matches;
    for (int i = 0; i < 60; ++i) {
      const Vector3d p = synthetic::visiblePoint(camera, &random);
      PointCorrespondence match;
      match.p_prev = truth.inverse() * p;
      match.sigma_px = 0.3;
      match.left_px = camera.projectLeft(p);
      match.right_px = camera.projectRight(p);
      match.left_px += Eigen::Vector2d(random.normal(0.3), random.normal(0.3));
      match.right_px += Eigen::Vector2d(random.normal(0.3), random.normal(0.3));
      matches.points.push_back(match);
    }
    const MotionEstimate estimate = estimateMotion(matches, camera, truth, parameters);
    ASSERT_TRUE(estimate.ok());
    EXPECT_LT(std::sqrt(estimate.covariance.diagonal().head(3).sum()), 0.02);
    const Vector6d error = errorOf(estimate, truth);
    nees += error.dot(estimate.covariance.inverse() * error) / kSeeds;
  }
  EXPECT_GT(nees, 4.0);
  EXPECT_LT(nees, 8.0);
}

TEST(EstimateMotion, SmallerNoiseGivesASmallerCovariance) {
  synthetic::MatchOptions options;
  options.noise_px = options.sigma_px = 0.1;
  const MotionEstimate fine =
      estimateMotion(synthetic::matches(synthetic::camera(), synthetic::motion(), options, 7),
                     synthetic::camera(), synthetic::motion(), {});
  options.noise_px = options.sigma_px = 1.0;
  const MotionEstimate coarse =
      estimateMotion(synthetic::matches(synthetic::camera(), synthetic::motion(), options, 7),
                     synthetic::camera(), synthetic::motion(), {});
  ASSERT_TRUE(fine.ok() && coarse.ok());
  EXPECT_NEAR(coarse.covariance.trace() / fine.covariance.trace(), 100.0, 40.0);
  EXPECT_NEAR(coarse.rms_px / fine.rms_px, 10.0, 2.5);
}

TEST(EstimateMotion, WeakAxesShowInTheCovariance) {
  // All points far away in one direction: what they say of the translation along it, and of the
  // roll about it, is little.
  const StereoCamera camera = synthetic::camera();
  synthetic::Random random(11);
  Correspondences distant;
  for (int i = 0; i < 40; ++i) {
    const Vector3d p(random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5),
                     random.uniform(99.0, 101.0));
    PointCorrespondence match;
    match.p_prev = p;
    match.covariance =
        triangulatePoint(camera, camera.projectLeft(p), camera.projectRight(p).x(), 0.3, 0.1)
            ->covariance;
    match.left_px = camera.projectLeft(p);
    match.right_px = camera.projectRight(p);
    match.sigma_px = 0.3;
    distant.points.push_back(match);
  }
  const MotionEstimate estimate = estimateMotion(distant, camera, Isometry3d::Identity(), {});
  ASSERT_TRUE(estimate.ok());
  ASSERT_TRUE(estimate.covariance.allFinite());
  // The matches have no noise, and residuals that show it lower the covariance by so much.
  const double shown = std::sqrt(20.0 / (4.0 * 40.0 - 6.0 + 20.0));
  EXPECT_GT(std::sqrt(estimate.covariance(2, 2)), 1.0 * shown);
  EXPECT_GT(estimate.covariance(5, 5), 100.0 * 1e-8);
  EXPECT_GT(std::sqrt(estimate.covariance(0, 0)), 0.5 * shown);
  EXPECT_GE(Eigen::SelfAdjointEigenSolver<Matrix6d>(estimate.covariance).eigenvalues().minCoeff(),
            0.0);
}

TEST(EstimateMotion, ParallelLinesLeaveOneAxisOpen) {
  const StereoCamera camera = synthetic::camera();
  Correspondences parallel;  // vertical posts do not say how far the camera has risen
  synthetic::Random random(12);
  for (int i = 0; i < 20; ++i) {
    LineCorrespondence line;
    line.start_prev = {random.uniform(-2.0, 2.0), -1.0, random.uniform(4.0, 9.0)};
    line.end_prev = line.start_prev + Vector3d(0.0, 2.0, 0.0);
    line.covariance = 1e-6 * Matrix6d::Identity();
    line.left_start_px = camera.projectLeft(line.start_prev);
    line.left_end_px = camera.projectLeft(line.end_prev);
    line.right_start_px = camera.projectRight(line.start_prev);
    line.right_end_px = camera.projectRight(line.end_prev);
    line.sigma_px = 0.3;
    parallel.lines.push_back(line);
  }
  const MotionEstimate estimate = estimateMotion(parallel, camera, Isometry3d::Identity(), {});
  ASSERT_TRUE(estimate.ok());
  ASSERT_TRUE(estimate.covariance.allFinite());
  EXPECT_GT(estimate.covariance(1, 1), 1e4 * estimate.covariance(0, 0));
}

// --- Motions that do not carry themselves

/// Points at infinity all over the image, seen again after a small turn.
Correspondences farPoints(const StereoCamera& camera, const Isometry3d& T_curr_prev) {
  Correspondences far;
  synthetic::Random random(13);
  for (int i = 0; i < 40; ++i) {
    const Eigen::Vector2d left(random.uniform(50.0, 590.0), random.uniform(50.0, 430.0));
    const TriangulatedPoint triangulated = triangulateFarPoint(camera, left, left.x(), 0.2);
    PointCorrespondence match;
    match.far = true;
    match.p_prev = triangulated.p_camera;
    match.covariance = triangulated.covariance;
    match.sigma_px = 0.2;
    match.left_px = camera.projectLeft(T_curr_prev.linear() * match.p_prev);
    match.right_px = match.left_px;
    far.points.push_back(match);
  }
  return far;
}

/// A point in front of the camera, seen again after a motion.
PointCorrespondence nearPoint(const StereoCamera& camera, const Isometry3d& T_curr_prev,
                              const Vector3d& p_prev) {
  PointCorrespondence match;
  match.p_prev = p_prev;
  match.covariance = 1e-6 * Eigen::Matrix3d::Identity();
  match.sigma_px = 0.2;
  match.left_px = camera.projectLeft(T_curr_prev * p_prev);
  match.right_px = camera.projectRight(T_curr_prev * p_prev);
  return match;
}

TEST(EstimateMotion, FarPointsTellTheRotationOnly) {
  const StereoCamera camera = synthetic::camera();
  const Isometry3d truth = synthetic::transform({0.01, -0.02, 0.005}, {0.0, 0.0, -1.0});
  const Isometry3d start = synthetic::transform({0.0, 0.0, 0.0}, {0.0, 0.0, -1.0});
  const MotionEstimate estimate = estimateMotion(farPoints(camera, truth), camera, start, {});
  ASSERT_TRUE(estimate.ok());
  EXPECT_LT(Eigen::AngleAxisd(estimate.T_curr_prev.linear() * truth.linear().transpose()).angle(),
            1e-4);
  EXPECT_LT((estimate.T_curr_prev.translation() - start.translation()).norm(), 1e-6);
  EXPECT_LT(std::sqrt(estimate.covariance(4, 4)), 1e-3);
  EXPECT_GT(std::sqrt(estimate.covariance.diagonal().head<3>().minCoeff()), 10.0);
}

TEST(EstimateMotion, WhatHangsOnOnePlaceIsNotKnown) {
  const StereoCamera camera = synthetic::camera();
  const Isometry3d truth = synthetic::transform({0.0, 0.0, 0.0}, {0.0, 0.0, -1.0});
  const auto sigma_z = [&](const std::vector<Vector3d>& near) {
    Correspondences matches = farPoints(camera, truth);
    for (const Vector3d& p : near) matches.points.push_back(nearPoint(camera, truth, p));
    const MotionEstimate estimate = estimateMotion(matches, camera, truth, {});
    EXPECT_TRUE(estimate.ok());
    return std::sqrt(estimate.covariance(2, 2));
  };
  EXPECT_GT(sigma_z({{1.0, 1.0, 6.0}}), 100.0);
  EXPECT_GT(sigma_z({{1.0, 1.0, 6.0}, {1.01, 1.0, 6.0}, {1.0, 1.01, 6.0}}), 100.0);
  EXPECT_LT(sigma_z({{1.0, 1.0, 6.0}, {-1.0, 1.0, 6.0}}), 0.5);
}

TEST(SupportByPrediction, TakesTheAxesThatThePredictionKnowsBetter) {
  MotionEstimate motion;
  motion.status = MotionStatus::kOk;
  motion.T_curr_prev = synthetic::transform({0.01, 0.02, 0.03}, {0.1, 0.2, 3.0}).inverse();
  Vector6d variances = Vector6d::Constant(1e-8);
  variances(2) = 1e6;
  motion.covariance = variances.asDiagonal();
  const Isometry3d predicted = synthetic::transform({0.0, 0.0, 0.0}, {0.0, 0.0, 1.0});
  const Matrix6d covariance = 1e-2 * Matrix6d::Identity();
  const Isometry3d measured = motion.T_curr_prev.inverse();
  ASSERT_TRUE(supportByPrediction(predicted, covariance, &motion));
  const Isometry3d supported = motion.T_curr_prev.inverse();
  EXPECT_NEAR(supported.translation().z(), 1.0, 1e-4);
  EXPECT_NEAR(supported.translation().x(), measured.translation().x(), 1e-5);
  EXPECT_TRUE(supported.linear().isApprox(measured.linear(), 1e-5));
  EXPECT_NEAR(motion.covariance(2, 2), 1e-2, 1e-4);
  EXPECT_NEAR(motion.covariance(4, 4), 1e-8, 1e-10);
}

TEST(SupportByPrediction, LeavesAMotionAloneThatIsKnownBetter) {
  MotionEstimate motion;
  motion.status = MotionStatus::kOk;
  motion.T_curr_prev = synthetic::transform({0.01, 0.02, 0.03}, {0.1, 0.2, 3.0}).inverse();
  motion.covariance = 1e-3 * Matrix6d::Identity();
  const Isometry3d before = motion.T_curr_prev;
  EXPECT_FALSE(supportByPrediction(Isometry3d::Identity(), 2e-3 * Matrix6d::Identity(), &motion));
  EXPECT_TRUE(motion.T_curr_prev.isApprox(before, 0.0));
}

TEST(PoseIntegrator, ErrorsOfAPredictionAddUp) {
  // The same time predicted in one step or in ten is as uncertain, but for the last step's weight.
  const auto sigma = [](int steps) {
    PoseIntegrator pose;
    pose.reset(Isometry3d::Identity());
    MotionStep step;
    step.T_measured = step.T_reference_camera = synthetic::transform({0, 0, 0}, {0, 0, 1.0});
    step.covariance = 1e-8 * Matrix6d::Identity();
    const std::int64_t second = 1000000000;
    pose.addMeasurement(step, 0.1, 0);
    for (int i = 1; i <= steps; ++i) pose.addPrediction(1.0 / steps, i * second / steps, 0.0);
    return std::sqrt(pose.covariance()(2, 2));
  };
  EXPECT_GT(sigma(1), 10.0);  // it may have gone on at 10 m/s
  EXPECT_GT(sigma(10), 0.8 * sigma(1));
}

}  // namespace
}  // namespace point_line_odometry
