
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <numeric>
#include <opencv2/core.hpp>
#include <optional>
#include <utility>

#include "common/thread_pool.h"
#include "geometry/se3.h"
#include "geometry/triangulation.h"
#include "motion/correspondence.h"
#include "motion/motion_cost.h"
#include "motion/motion_estimator.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/residual_histogram.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using synthetic::MatchOptions;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// --- What the solver sees

using Cost = MotionCost<ResidualImages::kBoth>;

TEST(MotionCost, BehindTheCameraIsRefused) {
  const StereoCamera camera = synthetic::camera();
  const Correspondences all = synthetic::matches(camera, synthetic::motion(), {1, 1}, 5);
  const MotionVector near{Vector3d::Zero(), synthetic::motion().translation()};
  const MotionVector far{Vector3d::Zero(), {0.0, 0.0, -30.0}};
  Correspondences point_alone = all;
  point_alone.lines.clear();
  Correspondences line_alone = all;
  line_alone.points.clear();
  for (const Correspondences& some : {point_alone, line_alone}) {
    Cost::Points points(some.points, camera);
    Cost::Lines lines(some.lines, camera);
    points.linearizeInformation(synthetic::motion(), true);
    lines.linearizeInformation(synthetic::motion(), true);
    const Cost cost(points, lines, 1.5);
    EXPECT_TRUE(cost(near));
    EXPECT_FALSE(cost(far));
  }
}

class MotionCostOfMany : public ::testing::Test {
 protected:
  MotionCostOfMany() {
    points_.linearizeInformation(synthetic::motion(), true);
    lines_.linearizeInformation(synthetic::motion(), true);
  }

  const StereoCamera camera_ = synthetic::camera();
  const Correspondences matches_ = synthetic::matches(camera_, synthetic::motion(), {30, 10}, 5);
  Cost::Points points_{matches_.points, camera_};
  Cost::Lines lines_{matches_.lines, camera_};
  const MotionVector start_ = MotionVector::from(synthetic::motion());
  const MotionVector moved_{start_.rotation + Vector3d(0.01, -0.02, 0.01),
                            start_.translation + Vector3d(0.1, 0.05, -0.2)};
};

TEST_F(MotionCostOfMany, SumsAreThoseOfTheResiduals) {
  MotionEquations expected;
  const Matrix6d to_parameters = moved_.perturbationByParameters();
  int residuals = 0;
  int weighted = 0;
  const Cost cost(points_, lines_, 1.5);
  for (int part = 0; part < Cost::kParts; ++part) {
    EXPECT_TRUE(cost.forEachResidual(
        moved_.toIsometry(), part, [&](const auto& r, const auto& J, const HuberLoss& loss) {
          const auto J_parameters = (J * to_parameters).eval();
          ++residuals;
          weighted += loss.weight < 1.0 ? 1 : 0;
          expected.cost += loss.cost;
          expected.gradient += loss.weight * J_parameters.transpose() * r;
          expected.information += loss.weight * J_parameters.transpose() * J_parameters;
        }));
  }
  EXPECT_EQ(residuals, 40);
  EXPECT_GT(weighted, 0);
  const std::optional<MotionEquations> equations = cost(moved_);
  ASSERT_TRUE(equations);
  EXPECT_NEAR(equations->cost / expected.cost, 1.0, 1e-12);
  EXPECT_TRUE(equations->gradient.isApprox(expected.gradient, 1e-9));
  EXPECT_TRUE(equations->information.isApprox(expected.information, 1e-12));
}

/// Where all residuals are far beyond delta, as after a wrong prediction, too.
TEST_F(MotionCostOfMany, GaussNewtonStepFromFarAwayDescends) {
  const Cost cost(points_, lines_, 1.5);
  const MotionEquations before = *cost(moved_);
  EXPECT_GT(before.cost, 40 * 10.0 * HuberLoss(1.5 * 1.5, 1.5).cost);
  const Vector6d step = before.information.ldlt().solve(before.gradient);
  const MotionVector after{moved_.rotation - step.head<3>(), moved_.translation - step.tail<3>()};
  EXPECT_LT(cost(after)->cost, 0.2 * before.cost);
}

TEST_F(MotionCostOfMany, ThreadsChangeNothing) {
  const MotionEquations alone = *Cost(points_, lines_, 1.5)(moved_);
  for (const int num_threads : {1, 2, 3}) {
    ThreadPool threads(num_threads);
    const MotionEquations shared = *Cost(points_, lines_, 1.5, &threads)(moved_);
    EXPECT_EQ(shared.cost, alone.cost);
    EXPECT_EQ(shared.gradient, alone.gradient);
    EXPECT_EQ(shared.information, alone.information);
  }
}

TEST_F(MotionCostOfMany, SevenResidualsHaveItsCostGradientAndNormalEquations) {
  const Cost cost(points_, lines_, 1.5);
  const ReducedMotionCost reduced(cost, start_);
  const double* parameters[] = {moved_.rotation.data(), moved_.translation.data()};
  using Jacobian = Eigen::Matrix<double, 7, 3, Eigen::RowMajor>;
  Eigen::Matrix<double, 7, 1> r;
  Jacobian J_rotation;
  Jacobian J_translation;
  double* jacobians[] = {J_rotation.data(), J_translation.data()};
  ASSERT_TRUE(reduced.Evaluate(parameters, r.data(), jacobians));
  Eigen::Matrix<double, 7, 6> J;
  J << J_rotation, J_translation;

  const MotionEquations equations = *cost(moved_);
  Vector6d from_start;
  from_start << moved_.rotation - start_.rotation, moved_.translation - start_.translation;
  EXPECT_NEAR(r.squaredNorm() / (2.0 * equations.cost + from_start.squaredNorm()), 1.0, 1e-12);
  EXPECT_TRUE((J.transpose() * r).isApprox(equations.gradient + from_start, 1e-9));
  EXPECT_TRUE((J.transpose() * J).isApprox(equations.information + Matrix6d::Identity(), 1e-12));

  // Without Jacobians, and with one of them, as the solver asks where a block is fixed; by a new
  // cost function, too, that has not evaluated anything yet.
  const ReducedMotionCost unused(cost, start_);
  for (const ReducedMotionCost* function : {&reduced, &unused}) {
    Eigen::Matrix<double, 7, 1> cost_alone;
    ASSERT_TRUE(function->Evaluate(parameters, cost_alone.data(), nullptr));
    EXPECT_EQ(cost_alone, r);
    Jacobian J_one;
    double* only_translation[] = {nullptr, J_one.data()};
    ASSERT_TRUE(function->Evaluate(parameters, cost_alone.data(), only_translation));
    EXPECT_EQ(J_one, J_translation);
  }
  // At another motion the last one does not count.
  const double* at_start[] = {start_.rotation.data(), start_.translation.data()};
  Eigen::Matrix<double, 7, 1> r_start;
  ASSERT_TRUE(reduced.Evaluate(at_start, r_start.data(), nullptr));
  EXPECT_NEAR(r_start.squaredNorm() / (2.0 * cost(start_)->cost), 1.0, 1e-9);
  EXPECT_GT(r.squaredNorm(), 2.0 * r_start.squaredNorm());
}

TEST(MotionVector, IsTheInverseOfIsometry) {
  for (const double angle : {0.0, 1e-9, 0.3, 3.0}) {
    const Isometry3d T = synthetic::transform(angle * Vector3d(0.6, -0.8, 0.0), {1.0, 2.0, 3.0});
    EXPECT_TRUE(MotionVector::from(T).toIsometry().isApprox(T, 1e-9)) << angle;
  }
}

// --- The estimator: exact data

double rotationError(const Isometry3d& a, const Isometry3d& b) {
  return logSO3(a.linear() * b.linear().transpose()).norm();
}

void expectMotion(const MotionEstimate& estimate, const Isometry3d& ground_truth,
                  double tolerance) {
  ASSERT_TRUE(estimate.ok()) << toString(estimate.status);
  EXPECT_LT((estimate.T_curr_prev.translation() - ground_truth.translation()).norm(), tolerance);
  EXPECT_LT(rotationError(estimate.T_curr_prev, ground_truth), tolerance);
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

TEST(EstimateMotion, NoMotion) {
  const Correspondences exact =
      synthetic::matches(synthetic::camera(), Isometry3d::Identity(), {}, 3);
  expectMotion(estimateMotion(exact, synthetic::camera(), Isometry3d::Identity(), {}),
               Isometry3d::Identity(), 1e-6);
  expectMotion(estimateMotion(exact, synthetic::camera(), synthetic::motion(), {}),
               Isometry3d::Identity(), 1e-6);
}

TEST(EstimateMotion, LargeRotationFromAGoodInitialValue) {
  const Isometry3d ground_truth = synthetic::transform({0.0, 0.0, 2.9}, {0.2, 0.1, 0.5});
  const Isometry3d start = synthetic::transform({0.0, 0.05, 2.8}, {0.0, 0.0, 0.3});
  const Correspondences exact = synthetic::matches(synthetic::camera(), ground_truth, {}, 4);
  expectMotion(estimateMotion(exact, synthetic::camera(), start, {}), ground_truth, 1e-6);
}

TEST(EstimateMotion, ForwardAndBackwardAreConsistent) {
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

/// Histograms of many estimates, added.
std::pair<ResidualHistogram, ResidualHistogram> residualsOf(double noise_px, double sigma_px) {
  std::pair<ResidualHistogram, ResidualHistogram> residuals;
  for (const unsigned seed : {1U, 2U, 3U, 4U, 5U, 6U, 7U, 8U}) {
    MatchOptions options{100, 40};
    options.noise_px = noise_px;
    options.sigma_px = sigma_px;
    const MotionEstimate estimate =
        estimateMotion(synthetic::matches(synthetic::camera(), synthetic::motion(), options, seed),
                       synthetic::camera(), Isometry3d::Identity(), {});
    EXPECT_TRUE(estimate.ok());
    EXPECT_EQ(estimate.point_residuals.size(), 3 * estimate.num_point_inliers);
    EXPECT_EQ(estimate.line_residuals.size(), 4 * estimate.num_line_inliers);
    residuals.first.add(estimate.point_residuals);
    residuals.second.add(estimate.line_residuals);
  }
  return residuals;
}

TEST(EstimateMotion, WhitenedResidualsHaveUnitVarianceIfTheNoiseIsCorrect) {
  const auto [points, lines] = residualsOf(0.3, 0.3);
  EXPECT_NEAR(points.variance(), 1.0, 0.06);
  EXPECT_NEAR(lines.variance(), 1.0, 0.06);
  // Of a normal distribution 38.3 % lie within half a standard deviation of 0.
  for (const ResidualHistogram* histogram : {&points, &lines}) {
    constexpr int kMiddle = ResidualHistogram::kMiddle;
    const auto within = std::accumulate(histogram->counts.begin() + kMiddle - 2,
                                        histogram->counts.begin() + kMiddle + 2, std::int64_t{0});
    EXPECT_NEAR(static_cast<double>(within) / static_cast<double>(histogram->size()), 0.383, 0.04);
  }
}

TEST(EstimateMotion, WhitenedResidualsAreSmallerIfTheNoiseIsOverestimated) {
  const auto [points, lines] = residualsOf(0.15, 0.3);
  EXPECT_NEAR(points.variance(), 0.25, 0.03);
  EXPECT_NEAR(lines.variance(), 0.25, 0.03);
}

TEST(ResidualHistogram, OutermostBinsContainAllBeyond) {
  ResidualHistogram histogram;
  for (const double value : {-100.0, -0.1, 0.0, 0.3, 100.0}) histogram.add(value);
  EXPECT_EQ(histogram.size(), 5);
  EXPECT_EQ(histogram.counts.front(), 1);
  EXPECT_EQ(histogram.counts[ResidualHistogram::kMiddle - 1], 1);
  EXPECT_EQ(histogram.counts[ResidualHistogram::kMiddle], 1);
  EXPECT_EQ(histogram.counts[ResidualHistogram::kMiddle + 1], 1);
  EXPECT_EQ(histogram.counts.back(), 1);
}

// --- The estimator: outliers and degenerate cases

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

PointCorrespondence matchOf(const TriangulatedPoint& point, const PointObservation& observation) {
  PointCorrespondence match;
  static_cast<PointObservation&>(match) = observation;
  match.p_prev = point.p_camera;
  match.covariance = point.covariance;
  return match;
}

/// Points of a wall, three of which have a depth that is far too small. A turn suits all of them, a
/// translation those with the right depth: no residual of the turn shows that the others are wrong.
TEST(EstimateMotion, AFewMatchesOfHighLeverageDoNotDetermineIt) {
  const StereoCamera camera = synthetic::camera();
  constexpr double kWall_m = 5.0;
  constexpr double kSigma_px = 0.15;
  Isometry3d downwards = Isometry3d::Identity();
  downwards.translation().y() = -0.03;
  for (const unsigned seed : {1U, 2U, 3U, 4U, 5U, 6U, 7U, 8U}) {
    cv::RNG random(seed);
    const auto noise = [&](double sigma) {
      return Vector2d{random.gaussian(sigma), random.gaussian(sigma)};
    };
    Correspondences matches;
    for (int i = 0; i < 150; ++i) {
      const Vector3d p{random.uniform(-2.0, 2.0), random.uniform(-1.5, 1.5), kWall_m};
      const double error_px = i < 3 ? 500.0 : 0.0;  // of the disparity, in both frames
      const double right_u_px = camera.projectRight(p).x() - error_px;
      const auto point =
          triangulatePoint(camera, camera.projectLeft(p), right_u_px, kSigma_px, 0.5);
      ASSERT_TRUE(point);
      const Vector2d left_px = camera.projectLeft(downwards * p) + noise(0.05);
      const Vector2d right_px =
          camera.projectRight(downwards * p) + noise(0.05) - Vector2d(error_px, 0.0);
      matches.points.push_back(matchOf(*point, {left_px, right_px, kSigma_px, 0.0}));
    }
    const MotionEstimate estimate = estimateMotion(matches, camera, Isometry3d::Identity(), {});
    expectMotion(estimate, downwards, 0.005);
    for (std::size_t i = 0; i < 3; ++i) EXPECT_FALSE(estimate.point_inliers[i]) << seed;
    EXPECT_EQ(estimate.num_point_inliers, 147) << seed;
  }
}

/// Far points, which tell the rotation, and eight near ones that are wrong together, as those of a
/// car that turns: without these, nothing of the translation by which they have shifted the others
/// may be left.
TEST(EstimateMotion, FarPointsTellTheRotationWhereNearOnesAreWrong) {
  StereoCamera camera = synthetic::camera();
  camera.baseline_m = 0.1;
  constexpr double kSigma_px = 0.2;
  const Isometry3d motion = synthetic::transform({0.002, 0.01, -0.001}, {0.0, 0.0, -0.3});
  for (unsigned seed = 0; seed < 50; ++seed) {
    synthetic::Random random(seed);
    Correspondences matches;
    for (int i = 0; i < 60; ++i) {
      const Vector2d pixel = random.uniform<2>({60.0, 20.0}, {600.0, 300.0});
      const Vector3d p = backProject(camera, pixel, random.uniform(0.2, 0.9));
      const TriangulatedPoint far =
          triangulateFarPoint(camera, pixel, camera.projectRight(p).x(), kSigma_px);
      matches.points.push_back(matchOf(
          far, {camera.projectLeft(motion * p) + random.normals<2>(kSigma_px),
                camera.projectRight(motion * p) + random.normals<2>(kSigma_px), kSigma_px, 0.0}));
      matches.points.back().far = true;
    }
    for (int i = 0; i < 8; ++i) {
      const Vector3d p = synthetic::visiblePoint(camera, &random);
      const auto near = triangulatePoint(camera, camera.projectLeft(p), camera.projectRight(p).x(),
                                         kSigma_px, 0.1);
      const Vector2d wrong = Vector2d(25.0, 0.0) + random.uniform<2>({-2.0, -2.0}, {2.0, 2.0});
      matches.points.push_back(
          matchOf(*near, {camera.projectLeft(motion * p) + wrong,
                          camera.projectRight(motion * p) + wrong, kSigma_px, 0.0}));
    }
    const MotionEstimate estimate = estimateMotion(matches, camera, motion, {});
    ASSERT_TRUE(estimate.ok()) << seed << " " << toString(estimate.status);
    EXPECT_GE(estimate.num_point_inliers, 55) << seed;
    EXPECT_LT(rotationAngle(estimate.T_curr_prev.linear() * motion.linear().transpose()), 1e-3)
        << seed;
  }
}

/// Points of a wall, and eight where an edge of it ends at that of a near one: they have the near
/// one's depth and follow the far one's rows. All their patches overlap.
TEST(EstimateMotion, MatchesOfOnePieceOfTheSceneDoNotDetermineIt) {
  const StereoCamera camera = synthetic::camera();
  constexpr double kSigma_px = 0.5;
  Isometry3d downwards = Isometry3d::Identity();
  downwards.translation().y() = -0.03;
  for (const unsigned seed : {1U, 2U, 3U, 4U, 5U, 6U, 7U, 8U}) {
    cv::RNG random(seed);
    Correspondences matches;
    for (int i = 0; i < 88; ++i) {
      const bool near = i < 8;
      Vector3d p{random.uniform(-2.0, 2.0), random.uniform(-1.5, 1.5), random.uniform(4.0, 6.0)};
      if (near) p = {random.uniform(-0.01, 0.01), random.uniform(0.28, 0.3), 1.0};
      const auto point = triangulatePoint(camera, camera.projectLeft(p), camera.projectRight(p).x(),
                                          kSigma_px, 0.5);
      ASSERT_TRUE(point);
      const Vector2d noise{random.gaussian(kSigma_px), random.gaussian(kSigma_px)};
      const Vector2d rows(0.0, near ? 0.8 * camera.fy * 0.03 : 0.0);
      const Vector2d left_px = camera.projectLeft(downwards * p) + rows + noise;
      const Vector2d right_px = camera.projectRight(downwards * p) + rows + noise;
      matches.points.push_back(matchOf(*point, {left_px, right_px, kSigma_px, 40.0}));
    }
    const MotionEstimate estimate = estimateMotion(matches, camera, Isometry3d::Identity(), {});
    expectMotion(estimate, downwards, 0.02);
    for (std::size_t i = 0; i < 8; ++i) EXPECT_FALSE(estimate.point_inliers[i]) << seed;
    EXPECT_GE(estimate.num_point_inliers, 75) << seed;
  }
}

/// Outliers with a common bias: kept, they are bounded by the Huber loss only.
TEST(EstimateMotion, OutliersMayBeKept) {
  constexpr int kSeeds = 20;
  const StereoCamera camera = synthetic::camera();
  const Isometry3d ground_truth = synthetic::motion();
  MatchOptions options{100, 0};
  options.noise_px = options.sigma_px = 0.3;
  MotionParameters removing;
  removing.residual_images = "left";
  MotionParameters keeping = removing;
  keeping.remove_outliers = false;
  MotionParameters laxer = keeping;
  laxer.outlier_threshold = 6.0;
  double removed_error = 0.0;
  double kept_error = 0.0;
  Vector3d pulled = Vector3d::Zero();
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    Correspondences matches = synthetic::matches(camera, ground_truth, options, seed);
    const MotionEstimate without = estimateMotion(matches, camera, ground_truth, keeping);
    for (int i = 0; i < 20; ++i) matches.points[i].left_px.y() += 10.0;
    const MotionEstimate removed = estimateMotion(matches, camera, ground_truth, removing);
    const MotionEstimate kept = estimateMotion(matches, camera, ground_truth, keeping);
    ASSERT_TRUE(without.ok() && removed.ok() && kept.ok());
    removed_error += rotationError(removed.T_curr_prev, ground_truth);
    kept_error += rotationError(kept.T_curr_prev, ground_truth);
    pulled += logSO3(kept.T_curr_prev.linear() * without.T_curr_prev.linear().transpose());
    // They are reported as outliers nevertheless.
    EXPECT_EQ(std::count(kept.point_inliers.begin(), kept.point_inliers.begin() + 20, true), 0);
    EXPECT_GT(kept.num_point_inliers, 70);
    // The problem is not solved again: the threshold has no effect on the estimate.
    EXPECT_EQ(estimateMotion(matches, camera, ground_truth, laxer).T_curr_prev.matrix(),
              kept.T_curr_prev.matrix());
  }
  // A fifth of the pixels are shifted down, which biases the rotation about x.
  EXPECT_GT(std::abs(pulled.x()), 3.0 * pulled.tail<2>().norm());
  EXPECT_LT(removed_error, 0.7 * kept_error);
}

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

TEST(EstimateMotion, NaNAnywhereNeverGivesOk) {
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

TEST(EstimateMotion, OneInvalidMatchDoesNotAffectTheFrame) {
  Correspondences one_bad = synthetic::matches(synthetic::camera(), synthetic::motion(), {}, 3);
  one_bad.points[0].left_px.x() = kNaN;
  expectMotion(estimateMotion(one_bad, synthetic::camera(), Isometry3d::Identity(), {}),
               synthetic::motion(), 1e-6);
}

// --- Fusion of rotations

TEST(FuseRotation, HalvesTheDifferenceAndSolvesForTheTranslationAgain) {
  const StereoCamera camera = synthetic::camera();
  const Isometry3d ground_truth = synthetic::motion();
  const Isometry3d T_prev_prev2 = synthetic::transform({-0.1, 0.2, 0.05}, {0.1, 0.2, -0.4});
  MatchOptions options{80, 30};
  options.noise_px = options.sigma_px = 0.3;
  const Correspondences noisy = synthetic::matches(camera, ground_truth, options, 13);
  const MotionEstimate frame_to_frame = estimateMotion(noisy, camera, Isometry3d::Identity(), {});
  ASSERT_TRUE(frame_to_frame.ok());
  const Vector3d difference(0.0006, -0.0004, 0.0008);  // of the two rotations k-1 -> k
  Isometry3d T_curr_prev2 = frame_to_frame.T_curr_prev * T_prev_prev2;
  T_curr_prev2.linear() = frame_to_frame.T_curr_prev.linear() *
                          synthetic::transform(difference, Vector3d::Zero()).linear() *
                          T_prev_prev2.linear();
  const MotionEstimate fused =
      fuseRotation(frame_to_frame, {T_curr_prev2, T_prev_prev2}, noisy, camera, {});
  ASSERT_TRUE(fused.ok());
  const Vector3d turned =
      logSO3(frame_to_frame.T_curr_prev.linear().transpose() * fused.T_curr_prev.linear());
  EXPECT_LT((turned - 0.5 * difference).norm(), 1e-9);
  // With the rotation fixed there, any change of the translation increases the sum of squares.
  const auto cost = [&](const Vector3d& shift) {
    Isometry3d T = fused.T_curr_prev;
    T.translation() += shift;
    double sum = 0.0;
    for (std::size_t i = 0; i < noisy.points.size(); ++i) {
      if (!fused.point_inliers[i]) continue;
      const PointResidual<ResidualImages::kBoth> residual(noisy.points[i], camera, T);
      Eigen::Matrix3d covariance = residual.jacobianByLandmark() * noisy.points[i].covariance *
                                   residual.jacobianByLandmark().transpose();
      covariance.diagonal().array() += 0.09;
      sum += residual.value.dot(covariance.inverse() * residual.value);
    }
    return sum;
  };
  EXPECT_GT((fused.T_curr_prev.translation() - frame_to_frame.T_curr_prev.translation()).norm(),
            1e-5);
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_GT(cost(0.03 * Vector3d::Unit(axis)), cost(Vector3d::Zero()));
    EXPECT_GT(cost(-0.03 * Vector3d::Unit(axis)), cost(Vector3d::Zero()));
  }
}

/// A two-frame motion of few and far features may be wrong.
TEST(FuseRotation, TheCovarianceCoversBothRotations) {
  MatchOptions options{80, 30};
  options.noise_px = options.sigma_px = 0.3;
  const StereoCamera camera = synthetic::camera();
  const Correspondences noisy = synthetic::matches(camera, synthetic::motion(), options, 13);
  const MotionEstimate frame_to_frame = estimateMotion(noisy, camera, Isometry3d::Identity(), {});
  ASSERT_TRUE(frame_to_frame.ok());
  const Matrix6d& alone = frame_to_frame.covariance;
  for (const double wrong : {0.0, 0.004}) {
    const Isometry3d two_frames =
        synthetic::transform({wrong, 0.0, 0.0}, Vector3d::Zero()) * frame_to_frame.T_curr_prev;
    const MotionEstimate fused =
        fuseRotation(frame_to_frame, {two_frames, Isometry3d::Identity()}, noisy, camera, {});
    ASSERT_TRUE(fused.ok());
    const Vector6d moved =
        poseDifference(fused.T_curr_prev.inverse(), frame_to_frame.T_curr_prev.inverse());
    ASSERT_NEAR(moved.tail<3>().norm(), 0.5 * wrong, 1e-4);
    EXPECT_LE(moved.dot(fused.covariance.ldlt().solve(moved)), 1.0);
    EXPECT_EQ(moved.dot(alone.ldlt().solve(moved)) > 36.0, wrong > 0.0);
  }
}

TEST(FuseRotation, AgreementChangesNothing) {
  const Correspondences exact =
      synthetic::matches(synthetic::camera(), synthetic::motion(), {}, 14);
  const MotionEstimate frame_to_frame =
      estimateMotion(exact, synthetic::camera(), Isometry3d::Identity(), {});
  const Isometry3d T_prev_prev2 = synthetic::transform({-0.1, 0.2, 0.05}, {0.1, 0.2, -0.4});
  const MotionEstimate fused =
      fuseRotation(frame_to_frame, {frame_to_frame.T_curr_prev * T_prev_prev2, T_prev_prev2}, exact,
                   synthetic::camera(), {});
  expectMotion(fused, synthetic::motion(), 1e-6);
  EXPECT_EQ(fused.num_point_inliers, frame_to_frame.num_point_inliers);
}

TEST(FuseRotation, AnInconsistentRotationKeepsTheFrameToFrameEstimate) {
  const Correspondences exact =
      synthetic::matches(synthetic::camera(), synthetic::motion(), {}, 15);
  const MotionEstimate frame_to_frame =
      estimateMotion(exact, synthetic::camera(), Isometry3d::Identity(), {});
  const Isometry3d far_off = synthetic::transform({0.0, 1.0, 0.0}, Vector3d::Zero());
  const MotionEstimate fused = fuseRotation(frame_to_frame, {far_off, Isometry3d::Identity()},
                                            exact, synthetic::camera(), {});
  expectMotion(fused, synthetic::motion(), 1e-6);
}

TEST(FuseRotation, TheTranslationComesFromAllMatchesWhereOutliersAreKept) {
  Correspondences mixed = synthetic::matches(synthetic::camera(), synthetic::motion(), {80, 0}, 16);
  for (int i = 0; i < 20; ++i) mixed.points[i].left_px.y() += 10.0;
  MotionParameters parameters;
  parameters.residual_images = "left";
  MotionEstimate frame_to_frame;
  frame_to_frame.status = MotionStatus::kOk;
  frame_to_frame.T_curr_prev = synthetic::motion();
  const auto fused = [&] {
    return fuseRotation(frame_to_frame, {synthetic::motion(), Isometry3d::Identity()}, mixed,
                        synthetic::camera(), parameters);
  };
  expectMotion(fused(), synthetic::motion(), 1e-6);
  parameters.remove_outliers = false;
  const MotionEstimate kept = fused();
  ASSERT_TRUE(kept.ok());
  EXPECT_GT(kept.T_curr_prev.translation().y() - synthetic::motion().translation().y(), 0.001);
  EXPECT_EQ(kept.num_point_inliers, 60);
}

}  // namespace
}  // namespace point_line_odometry
