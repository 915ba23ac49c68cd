#include "point_line_odometry/motion.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <functional>
#include <limits>
#include <memory>

#include "motion/residuals.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using synthetic::MatchOptions;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

StereoCamera handCamera() {
  StereoCamera camera = synthetic::camera();
  camera.fx = camera.fy = 1500.0;
  camera.cx = 600.0;
  camera.cy = 200.0;
  camera.baseline_m = 0.5;
  return camera;
}

// --- Residuals
// ------------------------------------------------------------------------------------

TEST(PointResidual, HandNumbers) {
  PointCorrespondence point;
  point.p_prev = {1.0, -0.5, 6.0};
  point.left_px = {902.0, 47.0};
  point.right_px = {746.0, 48.0};
  // One metre forward: seen at (900, 50) and (750, 50).
  const Isometry3d T = synthetic::transform(Vector3d::Zero(), {0.0, 0.0, -1.0});
  const PointResidual both(point, handCamera(), T, ResidualImages::kBoth);
  ASSERT_TRUE(both.valid);
  EXPECT_LT((both.value - Vector3d(2.0, -3.0, -4.0)).norm(), 1e-9);
  const PointResidual left(point, handCamera(), T, ResidualImages::kLeft);
  ASSERT_EQ(left.value.size(), 2);
  EXPECT_LT((left.value - Vector2d(2.0, -3.0)).norm(), 1e-9);
}

TEST(LineResidual, HandNumbers) {
  LineCorrespondence line;  // vertical, seen in columns 900 and 750
  line.start_prev = {1.0, -0.5, 5.0};
  line.end_prev = {1.0, 0.5, 5.0};
  line.left_start_px = {903.0, 20.0};
  line.left_end_px = {899.0, 500.0};
  line.right_start_px = {750.0, 20.0};
  line.right_end_px = {752.0, 300.0};
  const LineResidual residual(line, handCamera(), Isometry3d::Identity(), ResidualImages::kBoth);
  ASSERT_TRUE(residual.valid);
  ASSERT_EQ(residual.value.size(), 4);
  const double sign = residual.value(0) > 0.0 ? 1.0 : -1.0;
  EXPECT_LT((sign * residual.value - Eigen::Vector4d(3.0, -1.0, 0.0, 2.0)).norm(), 1e-9);
  const LineResidual left(line, handCamera(), Isometry3d::Identity(), ResidualImages::kLeft);
  ASSERT_EQ(left.value.size(), 2);
  EXPECT_LT((left.value - residual.value.head<2>()).norm(), 1e-12);
}

TEST(Residuals, AreZeroAtTheTruth) {
  const Correspondences exact = synthetic::matches(synthetic::camera(), synthetic::motion(), {}, 1);
  for (const PointCorrespondence& point : exact.points) {
    const PointResidual residual(point, synthetic::camera(), synthetic::motion(),
                                 ResidualImages::kBoth);
    ASSERT_TRUE(residual.valid);
    EXPECT_LT(residual.value.norm(), 1e-9);
  }
  for (const LineCorrespondence& line : exact.lines) {
    const LineResidual residual(line, synthetic::camera(), synthetic::motion(),
                                ResidualImages::kBoth);
    ASSERT_TRUE(residual.valid);
    EXPECT_LT(residual.value.norm(), 1e-8);
  }
}

TEST(Residuals, BehindTheCameraIsInvalid) {
  const Correspondences exact = synthetic::matches(synthetic::camera(), synthetic::motion(), {}, 1);
  const Isometry3d past = synthetic::transform(Vector3d::Zero(), {0.0, 0.0, -20.0});
  const Isometry3d turned = synthetic::transform({0.0, M_PI, 0.0}, Vector3d::Zero());
  for (const Isometry3d& T : {past, turned}) {
    EXPECT_FALSE(
        PointResidual(exact.points[0], synthetic::camera(), T, ResidualImages::kBoth).valid);
    EXPECT_FALSE(LineResidual(exact.lines[0], synthetic::camera(), T, ResidualImages::kLeft).valid);
  }
  LineCorrespondence half = exact.lines[0];  // one end in front is not enough
  half.end_prev.z() = -1.0;
  EXPECT_FALSE(
      LineResidual(half, synthetic::camera(), Isometry3d::Identity(), ResidualImages::kLeft).valid);
}

TEST(Residuals, LineThatIsSeenAsAPointIsInvalid) {
  LineCorrespondence line;
  line.start_prev = {0.2, 0.1, 2.0};
  line.end_prev = {0.4, 0.2, 4.0};
  EXPECT_FALSE(
      LineResidual(line, synthetic::camera(), Isometry3d::Identity(), ResidualImages::kLeft).valid);
}

TEST(Residuals, NaNIsInvalid) {
  PointCorrespondence point;
  point.p_prev = {0.0, 0.0, kNaN};
  EXPECT_FALSE(
      PointResidual(point, synthetic::camera(), Isometry3d::Identity(), ResidualImages::kBoth)
          .valid);
  LineCorrespondence line;
  line.start_prev = {0.0, 0.0, kNaN};
  line.end_prev = {1.0, 1.0, 4.0};
  EXPECT_FALSE(
      LineResidual(line, synthetic::camera(), Isometry3d::Identity(), ResidualImages::kBoth).valid);
}

/// Largest difference of a Jacobian from central differences of f, relative to its largest entry.
double jacobianError(const Eigen::MatrixXd& J, int columns,
                     const std::function<Eigen::VectorXd(const Eigen::VectorXd&)>& f) {
  constexpr double kStep = 1e-5;
  Eigen::MatrixXd numeric(J.rows(), columns);
  for (int c = 0; c < columns; ++c) {
    const Eigen::VectorXd step = kStep * Eigen::VectorXd::Unit(columns, c);
    numeric.col(c) = (f(step) - f(-step)) / (2.0 * kStep);
  }
  return (J - numeric).cwiseAbs().maxCoeff() / numeric.cwiseAbs().maxCoeff();
}

Isometry3d perturbed(const Isometry3d& T, const Eigen::VectorXd& d) {
  Isometry3d moved = T;
  moved.linear() = synthetic::transform(d.head<3>(), Vector3d::Zero()).linear() * T.linear();
  moved.translation() += d.tail<3>();
  return moved;
}

class JacobianTest : public ::testing::TestWithParam<ResidualImages> {
 protected:
  const StereoCamera camera_ = synthetic::camera();
  const Correspondences all_ = synthetic::matches(camera_, synthetic::motion(), {10, 10, 2.0}, 2);
  // Not the motion the pixels belong to: the residuals are not zero.
  const Isometry3d T_ = synthetic::transform({0.3, -0.2, 0.25}, {0.5, -0.2, 0.4});
};

TEST_P(JacobianTest, Point) {
  for (const PointCorrespondence& point : all_.points) {
    const PointResidual at(point, camera_, T_, GetParam());
    ASSERT_TRUE(at.valid);
    ASSERT_GT(at.value.norm(), 1.0);
    EXPECT_LT(
        jacobianError(at.by_motion, 6,
                      [&](const Eigen::VectorXd& d) {
                        return PointResidual(point, camera_, perturbed(T_, d), GetParam()).value;
                      }),
        1e-6);
    EXPECT_LT(jacobianError(at.by_point, 3,
                            [&](const Eigen::VectorXd& d) {
                              PointCorrespondence moved = point;
                              moved.p_prev += d;
                              return PointResidual(moved, camera_, T_, GetParam()).value;
                            }),
              1e-6);
  }
}

TEST_P(JacobianTest, Line) {
  for (const LineCorrespondence& line : all_.lines) {
    const LineResidual at(line, camera_, T_, GetParam());
    ASSERT_TRUE(at.valid);
    ASSERT_GT(at.value.norm(), 1.0);
    EXPECT_LT(
        jacobianError(at.by_motion, 6,
                      [&](const Eigen::VectorXd& d) {
                        return LineResidual(line, camera_, perturbed(T_, d), GetParam()).value;
                      }),
        1e-5);
    EXPECT_LT(jacobianError(at.by_end_points, 6,
                            [&](const Eigen::VectorXd& d) {
                              LineCorrespondence moved = line;
                              moved.start_prev += d.head<3>();
                              moved.end_prev += d.tail<3>();
                              return LineResidual(moved, camera_, T_, GetParam()).value;
                            }),
              1e-5);
  }
}

INSTANTIATE_TEST_SUITE_P(Images, JacobianTest,
                         ::testing::Values(ResidualImages::kLeft, ResidualImages::kBoth));

// --- Cost functions
// -------------------------------------------------------------------------------

template <typename Cost>
class CostGradientTest : public ::testing::Test {};

struct PointsOf {
  static PointCorrespondence take(const Correspondences& all) { return all.points[3]; }
};
struct LinesOf {
  static LineCorrespondence take(const Correspondences& all) { return all.lines[3]; }
};
template <typename CostType, typename SourceType>
struct Case {
  using Cost = CostType;
  using Source = SourceType;
};
using Costs = ::testing::Types<Case<PointCostLeft, PointsOf>, Case<PointCostBoth, PointsOf>,
                               Case<LineCostLeft, LinesOf>, Case<LineCostBoth, LinesOf>>;
TYPED_TEST_SUITE(CostGradientTest, Costs);

TYPED_TEST(CostGradientTest, AgreesWithNumericDerivatives) {
  using Cost = typename TypeParam::Cost;
  const StereoCamera camera = synthetic::camera();
  // Distant landmarks in the middle stay in front under a large rotation about the optical axis.
  const Isometry3d truth = synthetic::transform({0.1, -0.05, 2.6}, {0.1, -0.2, 1.0});
  const auto match = TypeParam::Source::take(synthetic::matches(camera, truth, {8, 8, 1.0}, 5));
  synthetic::Random random(6);
  typename Cost::SqrtInformation weight;
  for (int i = 0; i < weight.size(); ++i) weight(i) = random.uniform(-1.0, 1.0);
  const Cost cost(match, camera, weight);
  // Small angles take a branch of their own.
  for (const Vector3d& rotation : {Vector3d(0.0, 0.0, 0.0), Vector3d(1e-7, -1e-7, 0.0),
                                   Vector3d(0.05, -0.1, 0.2), Vector3d(0.15, -0.1, 2.5)}) {
    const Vector3d translation(0.3, -0.1, 0.8);
    const auto evaluate = [&](const Eigen::VectorXd& d, double** jacobians) {
      const Vector3d moved_rotation = rotation + d.head<3>();
      const Vector3d moved_translation = translation + d.tail<3>();
      const double* blocks[] = {moved_rotation.data(), moved_translation.data()};
      Eigen::VectorXd residuals(cost.num_residuals());
      EXPECT_TRUE(cost.Evaluate(blocks, residuals.data(), jacobians));
      return residuals;
    };
    using Block = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>;
    Block by_rotation(cost.num_residuals(), 3);
    Block by_translation(cost.num_residuals(), 3);
    double* jacobians[] = {by_rotation.data(), by_translation.data()};
    EXPECT_GT(evaluate(Vector6d::Zero(), jacobians).norm(), 1.0);
    Eigen::MatrixXd J(cost.num_residuals(), 6);
    J << by_rotation, by_translation;
    EXPECT_LT(jacobianError(J, 6, [&](const Eigen::VectorXd& d) { return evaluate(d, nullptr); }),
              1e-5);
  }
}

TEST(Cost, BehindTheCameraIsRefused) {
  const Correspondences all =
      synthetic::matches(synthetic::camera(), synthetic::motion(), {1, 1}, 5);
  const double rotation[] = {0.0, 0.0, 0.0};
  const double translation[] = {0.0, 0.0, -30.0};
  const double* blocks[] = {rotation, translation};
  double residuals[4];
  const PointCostBoth point(all.points[0], synthetic::camera(),
                            PointCostBoth::SqrtInformation::Identity());
  EXPECT_FALSE(point.Evaluate(blocks, residuals, nullptr));
  const LineCostBoth line(all.lines[0], synthetic::camera(),
                          LineCostBoth::SqrtInformation::Identity());
  EXPECT_FALSE(line.Evaluate(blocks, residuals, nullptr));
}

TEST(MotionVector, IsTheInverseOfIsometry) {
  for (const double angle : {0.0, 1e-9, 0.3, 3.0}) {
    const Isometry3d T = synthetic::transform(angle * Vector3d(0.6, -0.8, 0.0), {1.0, 2.0, 3.0});
    EXPECT_TRUE(MotionVector::from(T).toIsometry().isApprox(T, 1e-9)) << angle;
  }
}

// --- The estimator: exact data
// --------------------------------------------------------------------

double rotationError(const Isometry3d& a, const Isometry3d& b) {
  return synthetic::logarithm(a.linear() * b.linear().transpose()).norm();
}

void expectMotion(const MotionEstimate& estimate, const Isometry3d& truth, double tolerance) {
  ASSERT_TRUE(estimate.ok()) << toString(estimate.status);
  EXPECT_LT((estimate.T_curr_prev.translation() - truth.translation()).norm(), tolerance);
  EXPECT_LT(rotationError(estimate.T_curr_prev, truth), tolerance);
}

struct ExactCase {
  int points;
  int lines;
  const char* images;
  bool use_covariance;
};

class ExactMotionTest : public ::testing::TestWithParam<ExactCase> {};

TEST_P(ExactMotionTest, IsRecovered) {
  MotionParameters parameters;
  parameters.residual_images = GetParam().images;
  parameters.use_triangulation_covariance = GetParam().use_covariance;
  for (const unsigned seed : {1U, 2U, 3U, 4U, 5U}) {
    const Correspondences exact = synthetic::matches(synthetic::camera(), synthetic::motion(),
                                                     {GetParam().points, GetParam().lines}, seed);
    const MotionEstimate estimate =
        estimateMotion(exact, synthetic::camera(), Isometry3d::Identity(), parameters);
    expectMotion(estimate, synthetic::motion(), 1e-6);
    EXPECT_EQ(estimate.num_point_inliers, GetParam().points);
    EXPECT_EQ(estimate.num_line_inliers, GetParam().lines);
    EXPECT_LT(estimate.rms_px, 1e-4);
    EXPECT_GT(estimate.iterations, 0);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Kinds, ExactMotionTest,
    ::testing::Values(ExactCase{40, 0, "both", true}, ExactCase{0, 40, "both", true},
                      ExactCase{30, 20, "both", true}, ExactCase{40, 0, "left", true},
                      ExactCase{0, 40, "left", true}, ExactCase{30, 20, "left", true},
                      ExactCase{30, 20, "both", false}, ExactCase{30, 20, "left", false}));

TEST(EstimateMotion, StandingStill) {
  const Correspondences exact =
      synthetic::matches(synthetic::camera(), Isometry3d::Identity(), {}, 3);
  expectMotion(estimateMotion(exact, synthetic::camera(), Isometry3d::Identity(), {}),
               Isometry3d::Identity(), 1e-6);
  expectMotion(estimateMotion(exact, synthetic::camera(), synthetic::motion(), {}),
               Isometry3d::Identity(), 1e-6);
}

TEST(EstimateMotion, LargeRotationFromAGoodStart) {
  const Isometry3d truth = synthetic::transform({0.0, 0.0, 2.9}, {0.2, 0.1, 0.5});
  const Isometry3d start = synthetic::transform({0.0, 0.05, 2.8}, {0.0, 0.0, 0.3});
  const Correspondences exact = synthetic::matches(synthetic::camera(), truth, {}, 4);
  expectMotion(estimateMotion(exact, synthetic::camera(), start, {}), truth, 1e-6);
}

TEST(EstimateMotion, ThereAndBackAreConsistent) {
  const StereoCamera camera = synthetic::camera();
  const Isometry3d T = synthetic::motion();
  const Correspondences there = synthetic::matches(camera, T, {60, 0}, 5);
  Correspondences back;
  for (const PointCorrespondence& point : there.points) {
    PointCorrespondence reverse = point;
    reverse.p_prev = T * point.p_prev;
    reverse.covariance = T.linear() * point.covariance * T.linear().transpose();
    reverse.left_px = camera.projectLeft(point.p_prev);
    reverse.right_px = camera.projectRight(point.p_prev);
    back.points.push_back(reverse);
  }
  const MotionEstimate a = estimateMotion(there, camera, Isometry3d::Identity(), {});
  const MotionEstimate b = estimateMotion(back, camera, Isometry3d::Identity(), {});
  ASSERT_TRUE(a.ok() && b.ok());
  EXPECT_TRUE((a.T_curr_prev * b.T_curr_prev).isApprox(Isometry3d::Identity(), 1e-6));
}

// --- The estimator: noise
// -------------------------------------------------------------------------

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
  MatchOptions options{GetParam().points, GetParam().lines};
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
  // 6 for exact covariances; they are raised where residuals are large and never lowered.
  RecordProperty("nees", std::to_string(nees));
  EXPECT_LE(beyond, 3) << "of 900 errors beyond 3.5 sigma";
  EXPECT_GT(nees, 4.0);
  EXPECT_LT(nees, 8.0);
}

INSTANTIATE_TEST_SUITE_P(Kinds, NoisyMotionTest,
                         ::testing::Values(NoiseCase{60, 0, "both"}, NoiseCase{0, 60, "both"},
                                           NoiseCase{40, 30, "both"}, NoiseCase{40, 30, "left"}));

TEST(EstimateMotion, SmallerNoiseGivesASmallerCovariance) {
  MatchOptions options;
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

TEST(EstimateMotion, RemovesOutliers) {
  for (const unsigned seed : {1U, 2U, 3U, 4U, 5U, 6U, 7U, 8U}) {
    MatchOptions options{100, 40};
    options.noise_px = options.sigma_px = 0.3;
    options.outlier_share = 0.3;
    const Correspondences mixed =
        synthetic::matches(synthetic::camera(), synthetic::motion(), options, seed);
    const MotionEstimate estimate =
        estimateMotion(mixed, synthetic::camera(), Isometry3d::Identity(), {});
    expectMotion(estimate, synthetic::motion(), 0.02);
    ASSERT_EQ(estimate.point_inliers.size(), 100U);
    ASSERT_EQ(estimate.line_inliers.size(), 40U);
    int wrong_points = 0;
    int right_points = 0;
    for (int i = 0; i < 100; ++i)
      (i < 30 ? wrong_points : right_points) += estimate.point_inliers[i] ? 1 : 0;
    int wrong_lines = 0;
    int right_lines = 0;
    for (int i = 0; i < 40; ++i)
      (i < 12 ? wrong_lines : right_lines) += estimate.line_inliers[i] ? 1 : 0;
    EXPECT_EQ(wrong_points, 0) << seed;
    EXPECT_LE(wrong_lines, 1) << seed;
    EXPECT_GE(right_points, 68) << seed;
    EXPECT_GE(right_lines, 26) << seed;
    EXPECT_EQ(estimate.num_point_inliers, wrong_points + right_points);
    EXPECT_EQ(estimate.num_line_inliers, wrong_lines + right_lines);
  }
}

// --- The estimator: nasty cases
// -------------------------------------------------------------------

TEST(EstimateMotion, TooFewMatches) {
  const MotionEstimate none = estimateMotion({}, synthetic::camera(), Isometry3d::Identity(), {});
  EXPECT_EQ(none.status, MotionStatus::kTooFewMatches);
  const Correspondences seven =
      synthetic::matches(synthetic::camera(), synthetic::motion(), {4, 3}, 1);
  const MotionEstimate few = estimateMotion(seven, synthetic::camera(), Isometry3d::Identity(), {});
  EXPECT_EQ(few.status, MotionStatus::kTooFewMatches);
  EXPECT_EQ(few.point_inliers, std::vector<bool>(4, false));
  EXPECT_EQ(few.line_inliers, std::vector<bool>(3, false));
  const Correspondences eight =
      synthetic::matches(synthetic::camera(), synthetic::motion(), {4, 4}, 1);
  EXPECT_TRUE(estimateMotion(eight, synthetic::camera(), Isometry3d::Identity(), {}).ok());
}

TEST(EstimateMotion, MatchesBehindTheCameraDoNotCount) {
  Correspondences exact = synthetic::matches(synthetic::camera(), synthetic::motion(), {20, 20}, 1);
  for (int i = 0; i < 5; ++i) exact.points[i].p_prev.z() = exact.lines[i].start_prev.z() = -3.0;
  const MotionEstimate estimate =
      estimateMotion(exact, synthetic::camera(), Isometry3d::Identity(), {});
  expectMotion(estimate, synthetic::motion(), 1e-6);
  EXPECT_EQ(estimate.num_point_inliers, 15);
  EXPECT_EQ(estimate.num_line_inliers, 15);
  EXPECT_FALSE(estimate.point_inliers[0] || estimate.line_inliers[0]);
}

TEST(EstimateMotion, TooFewInliersWhenNothingAgrees) {
  synthetic::Random random(9);
  Correspondences wild = synthetic::matches(synthetic::camera(), synthetic::motion(), {40, 0}, 2);
  for (PointCorrespondence& point : wild.points) {
    point.left_px = {random.uniform(0.0, 640.0), random.uniform(0.0, 480.0)};
    point.right_px = {random.uniform(0.0, 640.0), random.uniform(0.0, 480.0)};
  }
  const MotionEstimate estimate =
      estimateMotion(wild, synthetic::camera(), Isometry3d::Identity(), {});
  EXPECT_EQ(estimate.status, MotionStatus::kTooFewInliers) << toString(estimate.status);
  EXPECT_EQ(estimate.num_point_inliers, 0);
}

TEST(EstimateMotion, NaNAnywhereIsNeverCalledOk) {
  using Spoil = std::function<void(Correspondences*)>;
  const std::vector<Spoil> spoils{
      [](Correspondences* c) { c->points[0].left_px.x() = kNaN; },
      [](Correspondences* c) { c->points[0].covariance(0, 0) = kNaN; },
      [](Correspondences* c) { c->points[0].p_prev.x() = kNaN; },
      [](Correspondences* c) { c->points[0].sigma_px = kNaN; },
      [](Correspondences* c) { c->lines[0].right_end_px.y() = kNaN; },
      [](Correspondences* c) { c->lines[0].start_prev.x() = kNaN; },
      [](Correspondences* c) { c->lines[0].covariance(3, 3) = kNaN; },
      [](Correspondences* c) { c->points[0].p_prev *= 1e200; },
      [](Correspondences* c) { c->points[0].left_px.x() = 1e300; },
      [](Correspondences* c) { c->lines[0].left_start_px.x() = 1e300; }};
  for (std::size_t i = 0; i < spoils.size(); ++i) {
    Correspondences spoiled = synthetic::matches(synthetic::camera(), synthetic::motion(), {}, 3);
    spoils[i](&spoiled);
    const MotionEstimate estimate =
        estimateMotion(spoiled, synthetic::camera(), Isometry3d::Identity(), {});
    if (!estimate.ok()) continue;
    expectMotion(estimate, synthetic::motion(), 1e-4);
    EXPECT_TRUE(estimate.covariance.allFinite()) << i;
    EXPECT_TRUE(std::isfinite(estimate.rms_px)) << i;
  }
  const Correspondences exact = synthetic::matches(synthetic::camera(), synthetic::motion(), {}, 3);
  Isometry3d start = Isometry3d::Identity();
  start.translation().x() = kNaN;
  EXPECT_FALSE(estimateMotion(exact, synthetic::camera(), start, {}).ok());
}

TEST(EstimateMotion, OneBadMatchDoesNotSpoilTheFrame) {
  Correspondences one_bad = synthetic::matches(synthetic::camera(), synthetic::motion(), {}, 3);
  one_bad.points[0].left_px.x() = kNaN;
  expectMotion(estimateMotion(one_bad, synthetic::camera(), Isometry3d::Identity(), {}),
               synthetic::motion(), 1e-6);
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
  EXPECT_GT(std::sqrt(estimate.covariance(2, 2)), 1.0);
  EXPECT_GT(estimate.covariance(5, 5), 100.0 * 1e-8);
  // Turning and shifting sideways look the same from far: strongly correlated, each weak.
  EXPECT_GT(std::sqrt(estimate.covariance(0, 0)), 0.5);
  EXPECT_GT(std::abs(estimate.covariance(0, 4)) /
                std::sqrt(estimate.covariance(0, 0) * estimate.covariance(4, 4)),
            0.95);
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

// --- Fusion of rotations
// --------------------------------------------------------------------------

TEST(FuseRotation, HalvesTheDifferenceAndSolvesForTheTranslationAgain) {
  const StereoCamera camera = synthetic::camera();
  const Isometry3d truth = synthetic::motion();
  const Isometry3d T_prev_prev2 = synthetic::transform({-0.1, 0.2, 0.05}, {0.1, 0.2, -0.4});
  MatchOptions options{80, 30};
  options.noise_px = options.sigma_px = 0.3;
  const Correspondences noisy = synthetic::matches(camera, truth, options, 13);
  const MotionEstimate direct = estimateMotion(noisy, camera, Isometry3d::Identity(), {});
  ASSERT_TRUE(direct.ok());
  const Vector3d difference(0.0006, -0.0004, 0.0008);  // of the two rotations k-1 -> k
  Isometry3d T_curr_prev2 = direct.T_curr_prev * T_prev_prev2;
  T_curr_prev2.linear() = direct.T_curr_prev.linear() *
                          synthetic::transform(difference, Vector3d::Zero()).linear() *
                          T_prev_prev2.linear();
  const MotionEstimate fused = fuseRotation(direct, T_curr_prev2, T_prev_prev2, noisy, camera, {});
  ASSERT_TRUE(fused.ok());
  const Vector3d turned =
      synthetic::logarithm(direct.T_curr_prev.linear().transpose() * fused.T_curr_prev.linear());
  EXPECT_LT((turned - 0.5 * difference).norm(), 1e-9);
  // With the rotation held there, moving the translation by hand makes the sum of squares larger.
  const auto cost = [&](const Vector3d& shift) {
    Isometry3d T = fused.T_curr_prev;
    T.translation() += shift;
    double sum = 0.0;
    for (std::size_t i = 0; i < noisy.points.size(); ++i) {
      if (!fused.point_inliers[i]) continue;
      const PointResidual residual(noisy.points[i], camera, T, ResidualImages::kBoth);
      Eigen::Matrix3d covariance =
          residual.by_point * noisy.points[i].covariance * residual.by_point.transpose();
      covariance.diagonal().array() += 0.09;
      sum += residual.value.dot(covariance.inverse() * residual.value);
    }
    return sum;
  };
  EXPECT_GT((fused.T_curr_prev.translation() - direct.T_curr_prev.translation()).norm(), 1e-5);
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_GT(cost(0.03 * Vector3d::Unit(axis)), cost(Vector3d::Zero()));
    EXPECT_GT(cost(-0.03 * Vector3d::Unit(axis)), cost(Vector3d::Zero()));
  }
}

TEST(FuseRotation, AgreementChangesNothing) {
  const Correspondences exact =
      synthetic::matches(synthetic::camera(), synthetic::motion(), {}, 14);
  const MotionEstimate direct =
      estimateMotion(exact, synthetic::camera(), Isometry3d::Identity(), {});
  const Isometry3d T_prev_prev2 = synthetic::transform({-0.1, 0.2, 0.05}, {0.1, 0.2, -0.4});
  const MotionEstimate fused = fuseRotation(direct, direct.T_curr_prev * T_prev_prev2, T_prev_prev2,
                                            exact, synthetic::camera(), {});
  expectMotion(fused, synthetic::motion(), 1e-6);
  EXPECT_EQ(fused.num_point_inliers, direct.num_point_inliers);
}

TEST(FuseRotation, FarOffRotationKeepsTheDirectEstimate) {
  const Correspondences exact =
      synthetic::matches(synthetic::camera(), synthetic::motion(), {}, 15);
  const MotionEstimate direct =
      estimateMotion(exact, synthetic::camera(), Isometry3d::Identity(), {});
  const Isometry3d far_off = synthetic::transform({0.0, 1.0, 0.0}, Vector3d::Zero());
  const MotionEstimate fused =
      fuseRotation(direct, far_off, Isometry3d::Identity(), exact, synthetic::camera(), {});
  expectMotion(fused, synthetic::motion(), 1e-6);
}

}  // namespace
}  // namespace point_line_odometry
