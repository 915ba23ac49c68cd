
#include "odometry/uncertainty.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "geometry/triangulation.h"
#include "motion/correspondence.h"
#include "motion/motion_estimator.h"
#include "odometry/pose_integrator.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/types.h"
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

/// Along the axes of the camera in between: here turned by a quarter about its optical axis.
TEST(CovarianceBetween, IsOfBothMotionsInTheAxesInBetween) {
  Eigen::Isometry3d T_begin_last = Eigen::Isometry3d::Identity();
  T_begin_last.linear() =
      Eigen::AngleAxisd(0.5 * M_PI, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  T_begin_last.translation() << 1.0, 2.0, 3.0;
  Vector6d last;
  last << 1.0, 2.0, 3.0, 4.0, 5.0, 6.0;
  Vector6d curr;
  curr << 10.0, 20.0, 30.0, 40.0, 50.0, 60.0;
  Vector6d expected;
  expected << 22.0, 11.0, 33.0, 55.0, 44.0, 66.0;
  const Matrix6d between = covarianceBetween(T_begin_last, last.asDiagonal(), curr.asDiagonal());
  EXPECT_TRUE(between.isApprox(Matrix6d(expected.asDiagonal()), 1e-9));
}

TEST(ComposeCovariance, NoUncertaintyStaysNone) {
  const Isometry3d T = synthetic::motion();
  EXPECT_EQ(composeCovariance(T, Matrix6d::Zero(), T, Matrix6d::Zero()), Matrix6d::Zero());
}

TEST(ComposeCovariance, NoMotionKeepsIt) {
  const Matrix6d covariance = someCovariance(1, 0.1);
  const Matrix6d same =
      composeCovariance(synthetic::motion(), covariance, Isometry3d::Identity(), Matrix6d::Zero());
  EXPECT_LT((same - covariance).norm(), 1e-12);
}

TEST(ComposeCovariance, HeadingErrorPropagatesToThePosition) {
  // 0.1 rad about y over 10 m forward: 1 m to the side, and forward nothing.
  Matrix6d pose = Matrix6d::Zero();
  pose(4, 4) = 0.01;
  const Isometry3d forward = synthetic::transform(Vector3d::Zero(), {0.0, 0.0, 10.0});
  const Matrix6d covariance =
      composeCovariance(Isometry3d::Identity(), pose, forward, Matrix6d::Zero());
  EXPECT_NEAR(covariance(0, 0), 1.0, 1e-12);
  EXPECT_NEAR(covariance(1, 1), 0.0, 1e-12);
  EXPECT_NEAR(covariance(2, 2), 0.0, 1e-12);
  EXPECT_NEAR(covariance(0, 4), 0.1, 1e-12);  // heading towards +x, the camera ends at +x
}

TEST(ComposeCovariance, MotionNoiseIsRotatedIntoOdom) {
  // A camera that faces odom's x: its z noise is odom's x noise.
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
    error.tail<3>() = logSO3(T.linear() * T_odom_curr.linear().transpose());
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

TEST(Velocity, RotationGivesAnArc) {
  // Forward at 1 m/s while rotating left by 90 deg in a second: the chord points 45 deg to the
  // left.
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

TEST(PredictionCovariance, UnknownSpeedCoversContinuedMotion) {
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
  const Isometry3d ground_truth = T_curr_prev.inverse();
  Vector6d error;
  error.head<3>() = found.translation() - ground_truth.translation();
  error.tail<3>() = logSO3(found.linear() * ground_truth.linear().transpose());
  return error;
}

/// Squared Mahalanobis distance of the error; 6 in the mean for exact covariances.
double squaredError(const MotionEstimate& estimate, const Isometry3d& T_curr_prev) {
  const Vector6d error = errorOf(estimate, T_curr_prev);
  return error.dot(estimate.covariance.inverse() * error);
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
  // A motion so large that confusing the axes of the two cameras would be noticed.
  const Isometry3d ground_truth = synthetic::transform({0.1, -0.15, 1.0}, {0.3, -0.2, 0.8});
  const Isometry3d start = synthetic::transform({0.1, -0.12, 0.9}, {0.0, 0.0, 0.6});
  double nees = 0.0;
  int beyond = 0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const Correspondences noisy =
        synthetic::matches(synthetic::camera(), ground_truth, options, seed);
    const MotionEstimate estimate = estimateMotion(noisy, synthetic::camera(), start, parameters);
    ASSERT_TRUE(estimate.ok());
    const Vector6d error = errorOf(estimate, ground_truth);
    nees += error.dot(estimate.covariance.inverse() * error) / kSeeds;
    for (int i = 0; i < 6; ++i) {
      const double sigmas = std::abs(error(i)) / std::sqrt(estimate.covariance(i, i));
      EXPECT_LT(sigmas, 4.5) << "seed " << seed << " axis " << i;
      beyond += sigmas > 3.5 ? 1 : 0;
    }
    EXPECT_LT(std::sqrt(estimate.covariance(2, 2)), 0.05);
  }
  // 6 for exact covariances. These have room for errors that all disparities or neighbouring
  // matches have in common, which these matches do not have.
  RecordProperty("nees", std::to_string(nees));
  EXPECT_LE(beyond, 3) << "of 900 errors beyond 3.5 sigma";
  EXPECT_GT(nees, 3.5);
  EXPECT_LT(nees, 8.0);
}

INSTANTIATE_TEST_SUITE_P(Kinds, NoisyMotionTest,
                         ::testing::Values(NoiseCase{240, 0, "both"}, NoiseCase{0, 240, "both"},
                                           NoiseCase{160, 120, "both"},
                                           NoiseCase{160, 120, "left"}));

/// The calibration is known to 0.05 px of disparity only, or less well, whatever the number of
/// matches.
TEST(EstimateMotion, CovarianceCoversACommonErrorOfDisparities) {
  const StereoCamera camera = synthetic::camera();
  const Isometry3d ground_truth = synthetic::transform(Vector3d::Zero(), {0.0, 0.0, -1.0});
  constexpr int kSeeds = 40;
  for (const double error_px : {StereoCorrection::kCalibratedPx, 0.2}) {
    for (const auto& [points, lines] : {std::pair{300, 0}, {0, 300}, {150, 150}}) {
      synthetic::MatchOptions options{points, lines};
      options.noise_px = options.sigma_px = 0.15;
      double nees = 0.0;
      for (unsigned seed = 1; seed <= kSeeds; ++seed) {
        options.disparity_error_px = seed % 2 == 0 ? error_px : -error_px;
        Correspondences matches = synthetic::matches(camera, ground_truth, options, seed);
        matches.disparity_error_px = error_px;
        const MotionEstimate estimate = estimateMotion(matches, camera, ground_truth, {});
        ASSERT_TRUE(estimate.ok()) << points << " points, " << lines << " lines, seed " << seed;
        nees += squaredError(estimate, ground_truth) / kSeeds;
      }
      // 6 for exact covariances; 13 with lines alone if only points have the common error.
      EXPECT_GT(nees, 3.0) << points << " points, " << lines << " lines, " << error_px << " px";
      EXPECT_LT(nees, 8.0) << points << " points, " << lines << " lines, " << error_px << " px";
    }
  }
}

/// As wrong as a velocity is with which a rolling shutter is corrected, so are the landmarks of the
/// previous frame and the pixels of this one: by the more the further their rows are from the
/// middle.
TEST(EstimateMotion, CovarianceCoversAWrongVelocityInARollingShutter) {
  const StereoCamera camera = synthetic::camera();
  const Isometry3d ground_truth = synthetic::motion();
  constexpr double kReadOut_s = 0.03;
  constexpr double kSigma = 0.03;  // [m/s], [rad/s]
  constexpr int kSeeds = 100;
  synthetic::MatchOptions options{300, 0};
  options.noise_px = options.sigma_px = 0.15;
  double nees = 0.0;
  double nees_if_right = 0.0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    Correspondences matches = synthetic::matches(camera, ground_truth, options, seed);
    synthetic::Random random(seed);
    const Vector6d error_before = random.normals<6>(kSigma);
    const Vector6d error_now = random.normals<6>(kSigma);
    const RollingShutter shutter(kReadOut_s, Vector6d::Zero(), Vector6d::Constant(kSigma * kSigma),
                                 true);
    const auto shift = [&](const Vector3d& p, const Vector6d& error) {
      const double t = shutter.timeOf(camera, camera.projectLeft(p).y());
      return Vector3d(t * (error.head<3>() + error.tail<3>().cross(p)));
    };
    for (PointCorrespondence& point : matches.points) {
      const Vector3d p = ground_truth * point.p_prev;
      const Vector3d seen = p + shift(p, error_now);
      point.left_px += camera.projectLeft(seen) - camera.projectLeft(p);
      point.right_px += camera.projectRight(seen) - camera.projectRight(p);
      point.p_prev += shift(point.p_prev, error_before);
    }
    const MotionEstimate if_right = estimateMotion(matches, camera, ground_truth, {});
    matches.shutter = shutter;
    const MotionEstimate estimate = estimateMotion(matches, camera, ground_truth, {});
    ASSERT_TRUE(estimate.ok() && if_right.ok()) << seed;
    nees += squaredError(estimate, ground_truth) / kSeeds;
    nees_if_right += squaredError(if_right, ground_truth) / kSeeds;
  }
  EXPECT_GT(nees, 3.0);  // 6 for exact covariances
  EXPECT_LT(nees, 9.0);
  EXPECT_GT(nees_if_right, 3.0 * nees);
}

TEST(EstimateMotion, CovarianceCoversAFewMatchesThatAreWrongTogether) {
  const StereoCamera camera = synthetic::camera();
  const Isometry3d ground_truth = synthetic::motion();
  constexpr int kSeeds = 200;
  constexpr int kWrong = 6;
  for (const int num_points : {16, 30, 80, 160}) {
    synthetic::MatchOptions options{num_points, 0};
    options.noise_px = options.sigma_px = 0.3;
    double nees = 0.0;
    int beyond = 0;
    for (unsigned seed = 1; seed <= kSeeds; ++seed) {
      Correspondences matches = synthetic::matches(camera, ground_truth, options, seed);
      std::vector<PointCorrespondence>& points = matches.points;
      const Eigen::Vector2d place = points.front().left_px;
      std::sort(points.begin(), points.end(), [&](const auto& a, const auto& b) {
        return (a.left_px - place).norm() < (b.left_px - place).norm();
      });
      synthetic::Random random(seed);
      const double direction = random.uniform(0.0, 2.0 * M_PI);
      const Eigen::Vector2d shift =
          3.0 * options.sigma_px * Eigen::Vector2d(std::cos(direction), std::sin(direction));
      for (int i = 0; i < kWrong; ++i) {
        points[i].left_px += shift;
        points[i].right_px += shift;
      }
      const MotionEstimate estimate = estimateMotion(matches, camera, ground_truth, {});
      ASSERT_TRUE(estimate.ok()) << num_points << " points, seed " << seed;
      const double squared = squaredError(estimate, ground_truth);
      nees += squared / kSeeds;
      beyond += squared > 36.0 ? 1 : 0;
    }
    // 6 for exact covariances.
    EXPECT_GT(nees, 4.5) << num_points;
    EXPECT_LT(nees, 8.0) << num_points;
    EXPECT_LE(beyond, 2) << num_points;
  }
}

/// The noise of disparities is in the landmarks and in the Jacobians by the motion; see
/// withRefinedLandmark(). With landmarks where they were triangulated, the translation is too short
/// by 0.011 (17 standard errors).
TEST(EstimateMotion, NoisyDisparitiesDoNotShortenTheTranslation) {
  const StereoCamera camera = synthetic::camera();
  const Isometry3d ground_truth = synthetic::transform(Vector3d::Zero(), {-0.3, 0.0, 0.0});
  synthetic::MatchOptions options{160, 0};
  options.noise_px = options.sigma_px = 2.0;
  constexpr int kSeeds = 600;
  double sum = 0.0;
  double squares = 0.0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const MotionEstimate estimate = estimateMotion(
        synthetic::matches(camera, ground_truth, options, seed), camera, ground_truth, {});
    ASSERT_TRUE(estimate.ok()) << "seed " << seed;
    const double relative =
        estimate.T_curr_prev.translation().x() / ground_truth.translation().x() - 1.0;
    sum += relative;
    squares += relative * relative;
  }
  const double mean = sum / kSeeds;
  const double standard_error = std::sqrt((squares / kSeeds - mean * mean) / kSeeds);
  EXPECT_LT(standard_error, 0.001);
  EXPECT_LT(std::abs(mean), 3.0 * standard_error) << mean << " +- " << standard_error;
}

/// A point in front of the camera, matched after a motion.
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

/// Mean NEES of motions from 40 groups of 4 points side by side. Half of a point's variance is the
/// noise of the current image, which is the same for all of a group.
double neesOfGroups(double patch_px) {
  const StereoCamera camera = synthetic::camera();
  const Isometry3d ground_truth = synthetic::motion();
  MotionParameters parameters;
  parameters.use_triangulation_covariance = false;
  constexpr double kSigmaPx = 0.3;
  constexpr int kSeeds = 200;
  double nees = 0.0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    synthetic::Random random(seed);
    Correspondences matches;
    for (int group = 0; group < 40; ++group) {
      const Vector3d p = synthetic::visiblePoint(camera, &random);
      const Eigen::Vector2d left_noise = random.normals<2>(std::sqrt(0.5) * kSigmaPx);
      const Eigen::Vector2d right_noise = random.normals<2>(std::sqrt(0.5) * kSigmaPx);
      for (int i = 0; i < 4; ++i) {
        PointCorrespondence match;
        match.p_prev = ground_truth.inverse() * p;
        match.sigma_px = kSigmaPx;
        match.patch_px = patch_px;
        match.left_px = camera.projectLeft(p) + left_noise;
        match.right_px = camera.projectRight(p) + right_noise;
        match.left_px += random.normals<2>(std::sqrt(0.5) * kSigmaPx);
        match.right_px += random.normals<2>(std::sqrt(0.5) * kSigmaPx);
        matches.points.push_back(match);
      }
    }
    const MotionEstimate estimate = estimateMotion(matches, camera, ground_truth, parameters);
    EXPECT_TRUE(estimate.ok());
    nees += squaredError(estimate, ground_truth) / kSeeds;
  }
  return nees;
}

TEST(EstimateMotion, PointsOfOverlappingPatchesShareNoise) {
  // 6 for exact covariances; a part of the image is left out of them.
  const double nees = neesOfGroups(44.0);
  EXPECT_GT(nees, 4.0);
  EXPECT_LT(nees, 7.0);
  EXPECT_GT(neesOfGroups(0.0), 10.0);  // as if they were independent
}

TEST(EstimateMotion, CorrelationFollowsTheCommonAreaOfPatches) {
  const StereoCamera camera = synthetic::camera();
  MotionParameters parameters;
  parameters.use_triangulation_covariance = false;
  // Pairs of points `distance` apart, whose patches are a factor of `scale` different in size:
  // variance relative to that of independent points.
  const auto inflation = [&](double distance_px, double scale) {
    std::vector<double> trace;
    for (const double patch_px : {0.0, 20.0}) {
      Correspondences matches;
      for (int i = 0; i < 24; ++i) {
        for (const double offset : {0.0, distance_px}) {
          PointCorrespondence match = nearPoint(camera, Isometry3d::Identity(), Vector3d::Zero());
          match.left_px = {70.0 + 100.0 * (i % 6) + offset, 70.0 + 100.0 * (i / 6)};
          match.p_prev = backProject(camera, match.left_px, 20.0 + i % 7);
          match.right_px = camera.projectRight(match.p_prev);
          match.patch_px = offset > 0.0 ? scale * patch_px : patch_px;
          matches.points.push_back(match);
        }
      }
      const MotionEstimate estimate =
          estimateMotion(matches, camera, Isometry3d::Identity(), parameters);
      EXPECT_TRUE(estimate.ok());
      trace.push_back(estimate.covariance.trace());
    }
    return trace[1] / trace[0];
  };
  EXPECT_NEAR(inflation(0.01, 1.0), 1.5, 0.01);
  EXPECT_NEAR(inflation(10.0, 1.0), 1.25, 0.02);
  EXPECT_NEAR(inflation(21.0, 1.0), 1.0, 1e-9);
  EXPECT_NEAR(inflation(1.0, 2.0), 1.25, 0.02);  // a quarter of the larger, all of the smaller
}

TEST(EstimateMotion, CovarianceIsCorrectFarFromTheOrigin) {
  // The position of the camera has a small variance though it is far from the origin: rotation and
  // translation of T_curr_prev are correlated, and must be so with the right sign.
  const StereoCamera camera = synthetic::camera();
  const Isometry3d ground_truth = synthetic::transform({0.3, -0.4, 0.9}, {30.0, 20.0, -40.0});
  MotionParameters parameters;
  parameters.use_triangulation_covariance = false;
  constexpr int kSeeds = 100;
  double nees = 0.0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    synthetic::Random random(seed);
    Correspondences matches;
    for (int i = 0; i < 240; ++i) {
      const Vector3d p = synthetic::visiblePoint(camera, &random);
      PointCorrespondence match;
      match.p_prev = ground_truth.inverse() * p;
      match.sigma_px = 0.3;
      match.left_px = camera.projectLeft(p);
      match.right_px = camera.projectRight(p);
      match.left_px += random.normals<2>(0.3);
      match.right_px += random.normals<2>(0.3);
      matches.points.push_back(match);
    }
    const MotionEstimate estimate = estimateMotion(matches, camera, ground_truth, parameters);
    ASSERT_TRUE(estimate.ok());
    EXPECT_LT(std::sqrt(estimate.covariance.diagonal().head(3).sum()), 0.02);
    nees += squaredError(estimate, ground_truth) / kSeeds;
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

TEST(EstimateMotion, WeakAxesHaveALargeCovariance) {
  // All points far away in one direction: they hardly constrain the translation along it and the
  // roll about it.
  const StereoCamera camera = synthetic::camera();
  synthetic::Random random(11);
  Correspondences distant;
  for (int i = 0; i < 40; ++i) {
    const Vector3d p = random.uniform<3>({-0.5, -0.5, 99.0}, {0.5, 0.5, 101.0});
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
  // The matches have no noise, and the variance factor lowers the covariance accordingly.
  const double shown = std::sqrt(20.0 / (4.0 * 40.0 - 6.0 + 20.0));
  EXPECT_GT(std::sqrt(estimate.covariance(2, 2)), 1.0 * shown);
  EXPECT_GT(estimate.covariance(5, 5), 100.0 * 1e-8);
  EXPECT_GT(std::sqrt(estimate.covariance(0, 0)), 0.5 * shown);
  EXPECT_GE(Eigen::SelfAdjointEigenSolver<Matrix6d>(estimate.covariance).eigenvalues().minCoeff(),
            0.0);
}

TEST(EstimateMotion, ParallelLinesLeaveOneAxisUnconstrained) {
  const StereoCamera camera = synthetic::camera();
  Correspondences parallel;  // vertical posts do not constrain vertical motion
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

// --- Motions with weakly constrained axes

/// Points at infinity all over the image, matched after a small rotation.
Correspondences farPoints(const StereoCamera& camera, const Isometry3d& T_curr_prev) {
  Correspondences far;
  synthetic::Random random(13);
  for (int i = 0; i < 40; ++i) {
    const Eigen::Vector2d left = random.uniform<2>({50.0, 50.0}, {590.0, 430.0});
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

TEST(EstimateMotion, FarPointsConstrainTheRotationOnly) {
  const StereoCamera camera = synthetic::camera();
  const Isometry3d ground_truth = synthetic::transform({0.01, -0.02, 0.005}, {0.0, 0.0, -1.0});
  const Isometry3d start = synthetic::transform({0.0, 0.0, 0.0}, {0.0, 0.0, -1.0});
  MotionEstimate estimate = estimateMotion(farPoints(camera, ground_truth), camera, start, {});
  ASSERT_TRUE(estimate.ok());
  EXPECT_LT(
      Eigen::AngleAxisd(estimate.T_curr_prev.linear() * ground_truth.linear().transpose()).angle(),
      1e-4);
  EXPECT_LT((estimate.T_curr_prev.translation() - start.translation()).norm(), 1e-6);
  EXPECT_GT(std::sqrt(estimate.covariance.diagonal().head<3>().minCoeff()), 100.0);
  // With the translation known, so is the rotation.
  ASSERT_TRUE(constrainByPrediction(start.inverse(), Matrix6d::Identity(), &estimate));
  EXPECT_LT(std::sqrt(estimate.covariance(4, 4)), 1e-3);
}

TEST(EstimateMotion, FarPointsInheritTheErrorOfTheTranslation) {
  // Far points whose disparity is known a little, and near points in a row, which leave the
  // translation sideways uncertain: an error of it passes for a rotation about the vertical.
  const StereoCamera camera = synthetic::camera();
  const Isometry3d ground_truth = synthetic::transform({0.0, 0.0, 0.0}, {0.0, 0.0, -1.0});
  const auto sigma = [&](double far_z_m) {
    Correspondences matches = farPoints(camera, ground_truth);
    for (PointCorrespondence& far : matches.points) {
      far.p_prev *= far_z_m / far.p_prev.z();
      far.covariance.setZero();
      far.left_px = camera.projectLeft(ground_truth * far.p_prev);
      far.right_px = camera.projectRight(ground_truth * far.p_prev);
    }
    for (int i = 0; i < 8; ++i) {
      matches.points.push_back(
          nearPoint(camera, ground_truth, {i < 4 ? 2.0 : -2.0, 1.0 + 0.1 * i, 20.0}));
      matches.points.back().sigma_px = 10.0;
    }
    const MotionEstimate estimate = estimateMotion(matches, camera, ground_truth, {});
    EXPECT_TRUE(estimate.ok());
    return Eigen::Vector2d(std::sqrt(estimate.covariance(0, 0)),
                           std::sqrt(estimate.covariance(4, 4)));
  };
  const double infinitely_far = sigma(1e6)[1];
  const Eigen::Vector2d hundred_metres = sigma(100.0);
  EXPECT_GT(hundred_metres[1], 3.0 * infinitely_far);
  EXPECT_GT(hundred_metres[1], 0.5 * hundred_metres[0] / 100.0);
}

TEST(EstimateMotion, TranslationNeedsEnoughMatchesThatAgree) {
  // 40 far points agree with any translation. Of 40 near ones, matched at random, some agree with a
  // wrong one.
  const StereoCamera camera = synthetic::camera();
  const Isometry3d ground_truth = synthetic::transform({0.0, 0.0, 0.0}, {0.0, 0.0, -1.0});
  for (unsigned seed = 1; seed <= 20; ++seed) {
    synthetic::Random random(seed);
    Correspondences matches = farPoints(camera, ground_truth);
    for (int i = 0; i < 40; ++i) {
      const Vector3d p = random.uniform<3>({-3.0, 1.0, 6.0}, {3.0, 1.5, 10.0});
      matches.points.push_back(nearPoint(camera, ground_truth, p));
      const Eigen::Vector2d wrong = random.uniform<2>({-25.0, -25.0}, {25.0, 25.0});
      matches.points.back().left_px += wrong;
      matches.points.back().right_px += wrong;
    }
    const MotionEstimate estimate =
        estimateMotion(matches, camera, Isometry3d::Identity(), MotionParameters());
    ASSERT_TRUE(estimate.ok());
    EXPECT_EQ(estimate.num_point_inliers, 40);
    EXPECT_GT(std::sqrt(estimate.covariance(2, 2)), 100.0) << seed;
  }
}

TEST(EstimateMotion, FewMatchesThatAgreeOnlyWithinTheLimitDoNotCarryATranslation) {
  // Ten near points beside 40 far ones, with residuals of their noise, or evenly spread over what
  // passes for inliers, as those of wrong matches.
  const StereoCamera camera = synthetic::camera();
  const Isometry3d ground_truth = synthetic::transform({0.0, 0.0, 0.0}, {0.0, 0.0, -1.0});
  constexpr double kSigmaPx = 0.2;
  constexpr int kSeeds = 20;
  int carried_by_wrong = 0;
  int carried_by_right = 0;
  for (const bool right : {false, true}) {
    for (unsigned seed = 1; seed <= kSeeds; ++seed) {
      synthetic::Random random(seed);
      Correspondences matches = farPoints(camera, ground_truth);
      for (int i = 0; i < 10; ++i) {
        const Vector3d p = random.uniform<3>({-3.0, 1.0, 6.0}, {3.0, 1.5, 10.0});
        PointCorrespondence near = nearPoint(camera, ground_truth, p);
        near.covariance = 1e-8 * Eigen::Matrix3d::Identity();
        near.sigma_px = kSigmaPx;
        const double most_px = (right ? 1.0 : 3.0) * kSigmaPx;
        const Vector3d error =
            random.uniform<3>(Vector3d::Constant(-most_px), Vector3d::Constant(most_px));
        near.left_px += error.head<2>();
        near.right_px.x() += error.z();
        matches.points.push_back(near);
      }
      const MotionEstimate estimate = estimateMotion(matches, camera, ground_truth, {});
      ASSERT_TRUE(estimate.ok());
      const bool carried = std::sqrt(estimate.covariance(2, 2)) < 100.0;
      (right ? carried_by_right : carried_by_wrong) += carried ? 1 : 0;
    }
  }
  EXPECT_EQ(carried_by_right, kSeeds);
  EXPECT_LT(carried_by_wrong, kSeeds / 2);  // 7; all by their number alone
}

TEST(EstimateMotion, FarPointsMoveByTheEstimatedTranslation) {
  // The camera moves five metres where none was expected. Far points in half of the image would
  // turn that into a rotation, and near ones that are hardly nearer would follow it.
  const StereoCamera camera = synthetic::camera();
  const Isometry3d ground_truth = synthetic::transform({0.0, 0.0, 0.0}, {0.0, 0.0, -5.0});
  synthetic::Random random(17);
  Correspondences matches;
  for (int i = 0; i < 150; ++i) {
    const bool far = i < 100;
    const double z = far ? random.uniform(400.0, 600.0) : random.uniform(100.0, 200.0);
    const Eigen::Vector2d left = random.uniform<2>({330.0, 50.0}, {590.0, 430.0});
    const Vector3d p(z * (left.x() - camera.cx) / camera.fx, z * (left.y() - camera.cy) / camera.fy,
                     z);
    PointCorrespondence match = nearPoint(camera, ground_truth, p);
    match.far = far;
    match.sigma_px = 1.0;
    matches.points.push_back(match);
  }
  const MotionEstimate estimate = estimateMotion(matches, camera, Isometry3d::Identity(), {});
  ASSERT_TRUE(estimate.ok());
  EXPECT_LT((estimate.T_curr_prev.translation() - ground_truth.translation()).norm(), 0.05);
  EXPECT_LT(Eigen::AngleAxisd(estimate.T_curr_prev.linear()).angle(), 1e-3);
}

TEST(EstimateMotion, MotionConstrainedByOneImagePartIsUncertain) {
  const StereoCamera camera = synthetic::camera();
  const Isometry3d ground_truth = synthetic::transform({0.0, 0.0, 0.0}, {0.0, 0.0, -1.0});
  const auto sigma_z = [&](int left, int right) {
    Correspondences matches = farPoints(camera, ground_truth);
    for (int i = 0; i < left + right; ++i) {
      const Vector3d p(i < left ? 1.0 : -1.0, 1.0 + 0.01 * i, 6.0);
      matches.points.push_back(nearPoint(camera, ground_truth, p));
    }
    const MotionEstimate estimate = estimateMotion(matches, camera, ground_truth, {});
    EXPECT_TRUE(estimate.ok());
    return std::sqrt(estimate.covariance(2, 2));
  };
  EXPECT_GT(sigma_z(1, 0), 100.0);
  EXPECT_GT(sigma_z(6, 0), 100.0);
  EXPECT_GT(sigma_z(1, 1), 100.0);  // fewer than motion/min_inliers
  EXPECT_LT(sigma_z(3, 3), 0.5);
}

TEST(ConstrainByPrediction, FusesAxesWithASmallerPredictedVariance) {
  MotionEstimate motion;
  motion.status = MotionStatus::kOk;
  motion.T_curr_prev = synthetic::transform({0.01, 0.02, 0.03}, {0.1, 0.2, 3.0}).inverse();
  Vector6d variances = Vector6d::Constant(1e-8);
  variances(2) = 1e6;
  motion.covariance = variances.asDiagonal();
  const Isometry3d predicted = synthetic::transform({0.0, 0.0, 0.0}, {0.0, 0.0, 1.0});
  const Matrix6d covariance = 1e-2 * Matrix6d::Identity();
  const Isometry3d measured = motion.T_curr_prev.inverse();
  ASSERT_TRUE(constrainByPrediction(predicted, covariance, &motion));
  const Isometry3d supported = motion.T_curr_prev.inverse();
  EXPECT_NEAR(supported.translation().z(), 1.0, 1e-4);
  EXPECT_NEAR(supported.translation().x(), measured.translation().x(), 1e-5);
  EXPECT_TRUE(supported.linear().isApprox(measured.linear(), 1e-5));
  EXPECT_NEAR(motion.covariance(2, 2), 1e-2, 1e-4);
  EXPECT_NEAR(motion.covariance(4, 4), 1e-8, 1e-10);
}

TEST(ConstrainByPrediction, StaysPositiveWhereTheMotionIsUnknown) {
  // Two unknown directions that are no axes: P - P S^-1 P would have variances below zero there.
  MotionEstimate motion;
  motion.status = MotionStatus::kOk;
  Vector6d variances = Vector6d::Constant(1e-8);
  variances(1) = variances(4) = 1e6;
  Matrix6d directions = Matrix6d::Identity();
  directions.topLeftCorner<3, 3>() = synthetic::transform({0.3, -0.5, 0.7}, {0, 0, 0}).linear();
  directions.bottomRightCorner<3, 3>() = synthetic::transform({-0.4, 0.2, 0.6}, {0, 0, 0}).linear();
  motion.covariance = directions * variances.asDiagonal() * directions.transpose();
  ASSERT_TRUE(constrainByPrediction(Isometry3d::Identity(), 1e-4 * Matrix6d::Identity(), &motion));
  const Matrix6d in_directions = directions.transpose() * motion.covariance * directions;
  for (const int unknown : {1, 4}) EXPECT_NEAR(in_directions(unknown, unknown), 1e-4, 1e-6);
  for (const int known : {0, 2, 3, 5}) EXPECT_NEAR(in_directions(known, known), 1e-8, 3e-9);
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(motion.covariance);
  EXPECT_GT(eigen.eigenvalues().minCoeff(), 0.0);
}

TEST(ConstrainByPrediction, LeavesAMotionWithSmallerVarianceUnchanged) {
  MotionEstimate motion;
  motion.status = MotionStatus::kOk;
  motion.T_curr_prev = synthetic::transform({0.01, 0.02, 0.03}, {0.1, 0.2, 3.0}).inverse();
  motion.covariance = 1e-3 * Matrix6d::Identity();
  const Isometry3d before = motion.T_curr_prev;
  EXPECT_FALSE(constrainByPrediction(Isometry3d::Identity(), 2e-3 * Matrix6d::Identity(), &motion));
  EXPECT_TRUE(motion.T_curr_prev.isApprox(before, 0.0));
}

TEST(PoseIntegrator, ErrorsOfAPredictionAddUp) {
  // The variance of a prediction hardly depends on the number of its steps.
  const auto sigma = [](int steps) {
    PoseIntegrator pose;
    pose.reset(Isometry3d::Identity());
    MotionStep step;
    step.T_measured = step.T_previous_camera = synthetic::transform({0, 0, 0}, {0, 0, 1.0});
    step.covariance = 1e-8 * Matrix6d::Identity();
    pose.addMeasurement(step, 0.1, 0.1, 0);
    for (int i = 1; i <= steps; ++i) pose.addPrediction(1.0 / steps, 0.0, {});
    return std::sqrt(pose.covariance()(2, 2));
  };
  EXPECT_GT(sigma(1), 10.0);  // it may have continued at 10 m/s
  EXPECT_GT(sigma(10), 0.8 * sigma(1));
}

/// Of wheels that measure 1 m/s within 0.05, and the turn about the vertical (y) within 0.05 rad/s.
MotionPrior tenthOfASecondByWheels() {
  MotionPrior prior;
  prior.T_prev_curr.translation().z() = 0.1;
  Vector6d deviations;
  deviations << 1e-4, 1e-4, 0.005, 1e-4, 0.005, 1e-4;
  prior.information = deviations.cwiseAbs2().cwiseInverse().asDiagonal();
  return prior;
}

TEST(PoseIntegrator, APriorCarriesAPoseOfUnknownVelocity) {
  const MotionPrior prior = tenthOfASecondByWheels();
  PoseIntegrator unknown;
  unknown.reset(Isometry3d::Identity());
  PoseIntegrator far_points_only = unknown;
  MotionStep step;
  step.covariance = 1e-8 * Matrix6d::Identity();
  step.covariance.diagonal().head<3>().setConstant(36.0);  // 60 m/s
  far_points_only.addMeasurement(step, 0.1, 0.1, 0);
  for (PoseIntegrator* pose : {&unknown, &far_points_only}) {
    for (int i = 0; i < 10; ++i) EXPECT_TRUE(pose->addPrediction(0.1, 5.0, {}, &prior));
    EXPECT_NEAR(pose->T_odom_camera().translation().z(), 1.0, 0.01);
    EXPECT_NEAR(pose->twist()[2], 1.0, 0.01);
    EXPECT_NEAR(std::sqrt(pose->twistCovariance()(2, 2)), 0.05, 0.005);
  }
}

TEST(PoseIntegrator, APredictedTwistIsAsUncertainAsTheVelocity) {
  PoseIntegrator pose;
  pose.reset(Isometry3d::Identity());
  MotionStep step;
  step.covariance = 0.25 * Matrix6d::Identity();  // 5 m/s, 5 rad/s
  pose.addMeasurement(step, 0.1, 0.1, 0);
  EXPECT_TRUE(pose.addPrediction(0.1, 0.5, {}));
  EXPECT_GE(pose.twistCovariance().diagonal().minCoeff(), 25.0);
}

/// Covered for an hour: the camera may be anywhere, but not faster than it can be.
TEST(PoseIntegrator, AnUnknownMotionKeepsToTheLimits) {
  TrackingParameters limits;
  limits.max_speed_m_s = 2.0;
  limits.max_turn_rate_deg_s = 90.0;
  for (const bool with_velocity : {false, true}) {
    PoseIntegrator pose;
    pose.reset(Isometry3d::Identity());
    MotionStep step;
    step.covariance = 1e-8 * Matrix6d::Identity();
    if (with_velocity) pose.addMeasurement(step, 0.1, 0.1, 0);
    for (int i = 0; i < 36000; ++i) EXPECT_FALSE(pose.addPrediction(0.1, 0.0, limits));
    const Vector6d twist = pose.twistCovariance().diagonal().cwiseSqrt();
    EXPECT_LE(twist.head<3>().maxCoeff(), 2.0 + 1e-9);
    EXPECT_LE(twist.tail<3>().maxCoeff(), M_PI / 2.0 + 1e-9);
    const Vector6d sigma = pose.covariance().diagonal().cwiseSqrt();
    EXPECT_LE(sigma.head<3>().maxCoeff(), 7201.0);
    EXPECT_GE(sigma.head<3>().minCoeff(), 7000.0);
    EXPECT_LE(sigma.tail<3>().maxCoeff(), M_PI + 1e-6);
    EXPECT_GE(sigma.tail<3>().minCoeff(), 3.0);
  }
}

TEST(PoseIntegrator, AfterALongGapTheRotationIsUnknown) {
  PoseIntegrator pose;
  pose.reset(Isometry3d::Identity());
  MotionStep step;
  step.covariance = 1e-8 * Matrix6d::Identity();
  pose.addMeasurement(step, 0.1, 0.1, 0);
  EXPECT_FALSE(pose.addPrediction(3.0, 0.5, {}));
  const Vector6d sigma = pose.covariance().diagonal().cwiseSqrt();
  EXPECT_NEAR(sigma.tail<3>().minCoeff(), M_PI, 0.1);
  EXPECT_GE(sigma.head<3>().minCoeff(), 20.0);
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(pose.covariance());
  EXPECT_GE(eigen.eigenvalues().minCoeff(), 0.0);
}

/// The way bends: after T seconds at v its end is 1/2 v w T^2 aside, by an error w of the turn
/// rate.
TEST(PoseIntegrator, AConstantErrorOfTheTurnRateBendsTheWay) {
  const MotionPrior prior = tenthOfASecondByWheels();
  PoseIntegrator pose;
  pose.reset(Isometry3d::Identity());
  for (int i = 0; i < 100; ++i) pose.addPrediction(0.1, 60.0, {}, &prior);
  const Vector6d sigma = pose.covariance().diagonal().cwiseSqrt();
  EXPECT_NEAR(sigma[0], 2.5, 0.1);   // aside
  EXPECT_LT(sigma[1], 0.12);         // up: 1e-3 rad/s about x
  EXPECT_NEAR(sigma[2], 0.5, 0.05);  // along the way
  EXPECT_NEAR(sigma[4], 0.5, 0.01);
  EXPECT_NEAR(pose.covariance()(0, 4), 2.5 * 0.5, 0.1) << "of one cause";
  EXPECT_TRUE(pose.predictedCovariance().isApprox(pose.covariance(), 0.01));
}

}  // namespace
}  // namespace point_line_odometry
