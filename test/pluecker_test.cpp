
#include "geometry/pluecker.h"

#include <gtest/gtest.h>

#include <functional>
#include <limits>

#include "motion/motion_cost.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::Vector4d;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

TEST(PlueckerLine, HandNumbers) {
  const auto line = PlueckerLine::throughPoints(Vector3d(1.0, 0.0, 5.0), Vector3d(1.0, 2.0, 5.0));
  EXPECT_EQ(line.v, Vector3d(0.0, 2.0, 0.0));
  EXPECT_EQ(line.n, Vector3d(-10.0, 0.0, 2.0));
}

TEST(PlueckerLine, MomentIsPointCrossDirection) {
  synthetic::Random random(1);
  for (int i = 0; i < 50; ++i) {
    const Vector3d a = synthetic::visiblePoint(synthetic::camera(), &random);
    const Vector3d b = synthetic::visiblePoint(synthetic::camera(), &random);
    const auto line = PlueckerLine::throughPoints(a, b);
    EXPECT_LT((line.n - a.cross(line.v)).norm(), 1e-11);
    EXPECT_LT((line.n - b.cross(line.v)).norm(), 1e-11);
    EXPECT_LT((line.v - (b - a)).norm(), 1e-12);
  }
}

TEST(PlueckerLine, ScaleOfHomogeneousPointsScalesTheLine) {
  const Vector4d a(1.0, -2.0, 7.0, 1.0);
  const Vector4d b(0.5, 1.0, 4.0, 1.0);
  const auto line = PlueckerLine::throughPoints(a, b);
  const auto scaled = PlueckerLine::throughPoints(Vector4d(2.0 * a), Vector4d(-3.0 * b));
  EXPECT_LT((scaled.n + 6.0 * line.n).norm(), 1e-12);
  EXPECT_LT((scaled.v + 6.0 * line.v).norm(), 1e-12);
}

TEST(PlueckerLine, OrderOfPointsReversesTheLine) {
  const Vector3d a(1.0, -2.0, 7.0);
  const Vector3d b(0.5, 1.0, 4.0);
  EXPECT_EQ(PlueckerLine::throughPoints(a, b).n, -PlueckerLine::throughPoints(b, a).n);
  EXPECT_EQ(PlueckerLine::throughPoints(a, b).v, -PlueckerLine::throughPoints(b, a).v);
}

TEST(PlueckerLine, PointAtInfinityGivesTheDirection) {
  const Vector3d a(1.0, -2.0, 7.0);
  const Vector3d direction(0.3, 0.4, -0.2);
  const auto line = PlueckerLine::throughPoints(
      Vector4d(a.homogeneous()), Vector4d(direction.x(), direction.y(), direction.z(), 0.0));
  const auto finite = PlueckerLine::throughPoints(a, Vector3d(a + direction));
  EXPECT_LT((line.v - finite.v).norm(), 1e-12);
  EXPECT_LT((line.n - finite.n).norm(), 1e-12);
}

TEST(PlueckerLine, LineAtInfinityHasNoDirection) {
  const auto line =
      PlueckerLine::throughPoints(Vector4d(1.0, 0.0, 1.0, 0.0), Vector4d(0.0, 1.0, 1.0, 0.0));
  EXPECT_EQ(line.v, Vector3d::Zero());
  EXPECT_EQ(line.n, Vector3d(-1.0, -1.0, 1.0));
}

TEST(PlueckerLine, SamePointTwiceIsNoLine) {
  const Vector3d a(1.0, -2.0, 7.0);
  EXPECT_EQ(PlueckerLine::throughPoints(a, a).v, Vector3d::Zero());
  EXPECT_EQ(PlueckerLine::throughPoints(a, a).n, Vector3d::Zero());
}

TEST(PlueckerLine, TransformAgreesWithTransformedEndPoints) {
  synthetic::Random random(2);
  for (int i = 0; i < 50; ++i) {
    const Vector3d a = synthetic::visiblePoint(synthetic::camera(), &random);
    const Vector3d b = synthetic::visiblePoint(synthetic::camera(), &random);
    const Vector3d rotation = random.uniform<3>({-3.0, -3.0, -3.0}, {3.0, 3.0, 3.0});
    const Vector3d translation = random.uniform<3>({-9.0, -9.0, -9.0}, {9.0, 9.0, 9.0});
    const Eigen::Isometry3d T = synthetic::transform(rotation, translation);
    const auto moved = PlueckerLine::throughPoints(a, b).transformed(T);
    const auto expected = PlueckerLine::throughPoints(Vector3d(T * a), Vector3d(T * b));
    EXPECT_LT((moved.n - expected.n).norm(), 1e-10);
    EXPECT_LT((moved.v - expected.v).norm(), 1e-10);
    const auto back = moved.transformed(T.inverse());
    EXPECT_LT((back.n - a.cross(b)).norm(), 1e-9);
  }
}

TEST(LineProjection, HandNumbers) {
  StereoCamera camera = synthetic::camera();
  camera.fx = 1500.0;
  camera.fy = 1000.0;
  camera.cx = 600.0;
  camera.cy = 200.0;
  // A vertical line at x = 1 m, z = 5 m projects to column 1500 / 5 + 600.
  const auto line = PlueckerLine::throughPoints(Vector3d(1.0, 0.0, 5.0), Vector3d(1.0, 2.0, 5.0));
  const Vector3d image_line = lineProjectionMatrix(camera) * line.n;
  EXPECT_NEAR(image_line.y(), 0.0, 1e-9);
  EXPECT_NEAR(-image_line.z() / image_line.x(), 900.0, 1e-9);
  // A horizontal one at y = 2 m, z = 4 m in row 1000 * 2 / 4 + 200.
  const auto level = PlueckerLine::throughPoints(Vector3d(-1.0, 2.0, 4.0), Vector3d(3.0, 2.0, 4.0));
  const Vector3d row = lineProjectionMatrix(camera) * level.n;
  EXPECT_NEAR(row.x(), 0.0, 1e-9);
  EXPECT_NEAR(-row.z() / row.y(), 700.0, 1e-9);
}

TEST(LineProjection, IsTheLineThroughTheProjectedEndPointsInBothImages) {
  const StereoCamera camera = synthetic::camera();
  const Eigen::Isometry3d T_right_left =
      synthetic::transform(Vector3d::Zero(), {-camera.baseline_m, 0.0, 0.0});
  synthetic::Random random(3);
  for (int i = 0; i < 50; ++i) {
    const Vector3d a = synthetic::visiblePoint(camera, &random);
    const Vector3d b = synthetic::visiblePoint(camera, &random);
    const auto line = PlueckerLine::throughPoints(a, b);
    const Eigen::Matrix3d K_l = lineProjectionMatrix(camera);
    const Vector3d left = (K_l * line.n).normalized();
    const Vector3d right = (K_l * line.transformed(T_right_left).n).normalized();
    const Vector3d expected_left =
        camera.projectLeft(a).homogeneous().cross(camera.projectLeft(b).homogeneous()).normalized();
    const Vector3d expected_right = camera.projectRight(a)
                                        .homogeneous()
                                        .cross(camera.projectRight(b).homogeneous())
                                        .normalized();
    EXPECT_LT((left - expected_left).norm(), 1e-9);
    EXPECT_LT((right - expected_right).norm(), 1e-9);
    EXPECT_NEAR(distanceToLine(K_l * line.n, camera.projectLeft(0.3 * a + 0.7 * b)), 0.0, 1e-8);
  }
}

TEST(LineProjection, LineAtInfinityIsTheHorizon) {
  const StereoCamera camera = synthetic::camera();
  const auto horizon =
      PlueckerLine::throughPoints(Vector4d(1.0, 0.0, 1.0, 0.0), Vector4d(-1.0, 0.0, 1.0, 0.0));
  const Vector3d line = lineProjectionMatrix(camera) * horizon.n;
  EXPECT_NEAR(distanceToLine(line, Vector2d(17.0, camera.cy)), 0.0, 1e-9);
  EXPECT_NEAR(std::abs(distanceToLine(line, Vector2d(17.0, camera.cy + 3.0))), 3.0, 1e-9);
}

TEST(DistanceToLine, IsSignedAndInPixels) {
  const Vector3d line(3.0, 4.0, -10.0);  // 3 u + 4 v = 10
  EXPECT_NEAR(distanceToLine(line, Vector2d(2.0, 1.0)), 0.0, 1e-12);
  EXPECT_NEAR(distanceToLine(line, Vector2d(5.0, 5.0)), 5.0, 1e-12);
  EXPECT_NEAR(distanceToLine(7.0 * line, Vector2d(5.0, 5.0)), 5.0, 1e-12);
  EXPECT_NEAR(distanceToLine(-line, Vector2d(5.0, 5.0)), -5.0, 1e-12);
}

TEST(DistanceToLine, LineThroughTheCameraCentreHasNone) {
  // It projects to a point: its distance is not finite.
  const auto line = PlueckerLine::throughPoints(Vector3d(0.0, 0.0, 1.0), Vector3d(0.0, 0.0, 2.0));
  EXPECT_FALSE(std::isfinite(
      distanceToLine(lineProjectionMatrix(synthetic::camera()) * line.n, Vector2d(1.0, 2.0))));
}

// --- Residuals

TEST(PointResidual, HandNumbers) {
  PointCorrespondence point;
  point.p_prev = {1.0, -0.5, 6.0};
  point.left_px = {902.0, 47.0};
  point.right_px = {746.0, 48.0};
  // One metre forward: pixels (900, 50) and (750, 50).
  const Isometry3d T = synthetic::transform(Vector3d::Zero(), {0.0, 0.0, -1.0});
  const PointResidual<ResidualImages::kBoth> both(point, synthetic::handCamera(), T);
  ASSERT_TRUE(both.valid);
  EXPECT_LT((both.value - Vector3d(2.0, -3.0, -4.0)).norm(), 1e-9);
  const PointResidual<ResidualImages::kLeft> left(point, synthetic::handCamera(), T);
  ASSERT_EQ(left.value.size(), 2);
  EXPECT_LT((left.value - Vector2d(2.0, -3.0)).norm(), 1e-9);
}

TEST(LineResidual, HandNumbers) {
  LineCorrespondence line;  // vertical, in columns 900 and 750
  line.start_prev = {1.0, -0.5, 5.0};
  line.end_prev = {1.0, 0.5, 5.0};
  line.left_start_px = {903.0, 20.0};
  line.left_end_px = {899.0, 500.0};
  line.right_start_px = {750.0, 20.0};
  line.right_end_px = {752.0, 300.0};
  const LineResidual<ResidualImages::kBoth> residual(line, synthetic::handCamera(),
                                                     Isometry3d::Identity());
  ASSERT_TRUE(residual.valid);
  ASSERT_EQ(residual.value.size(), 4);
  const double sign = residual.value(0) > 0.0 ? 1.0 : -1.0;
  EXPECT_LT((sign * residual.value - Eigen::Vector4d(3.0, -1.0, 0.0, 2.0)).norm(), 1e-9);
  const LineResidual<ResidualImages::kLeft> left(line, synthetic::handCamera(),
                                                 Isometry3d::Identity());
  ASSERT_EQ(left.value.size(), 2);
  EXPECT_LT((left.value - residual.value.head<2>()).norm(), 1e-12);
}

TEST(Residuals, AreZeroAtTheTrueMotion) {
  const Correspondences exact = synthetic::matches(synthetic::camera(), synthetic::motion(), {}, 1);
  for (const PointCorrespondence& point : exact.points) {
    const PointResidual<ResidualImages::kBoth> residual(point, synthetic::camera(),
                                                        synthetic::motion());
    ASSERT_TRUE(residual.valid);
    EXPECT_LT(residual.value.norm(), 1e-9);
  }
  for (const LineCorrespondence& line : exact.lines) {
    const LineResidual<ResidualImages::kBoth> residual(line, synthetic::camera(),
                                                       synthetic::motion());
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
        PointResidual<ResidualImages::kBoth>(exact.points[0], synthetic::camera(), T).valid);
    EXPECT_FALSE(LineResidual<ResidualImages::kLeft>(exact.lines[0], synthetic::camera(), T).valid);
  }
  LineCorrespondence half = exact.lines[0];  // one end in front is not enough
  half.end_prev.z() = -1.0;
  EXPECT_FALSE(
      LineResidual<ResidualImages::kLeft>(half, synthetic::camera(), Isometry3d::Identity()).valid);
}

TEST(Residuals, LineThatProjectsToAPointIsInvalid) {
  LineCorrespondence line;
  line.start_prev = {0.2, 0.1, 2.0};
  line.end_prev = {0.4, 0.2, 4.0};
  EXPECT_FALSE(
      LineResidual<ResidualImages::kLeft>(line, synthetic::camera(), Isometry3d::Identity()).valid);
}

TEST(Residuals, NaNIsInvalid) {
  PointCorrespondence point;
  point.p_prev = {0.0, 0.0, kNaN};
  EXPECT_FALSE(
      PointResidual<ResidualImages::kBoth>(point, synthetic::camera(), Isometry3d::Identity())
          .valid);
  LineCorrespondence line;
  line.start_prev = {0.0, 0.0, kNaN};
  line.end_prev = {1.0, 1.0, 4.0};
  EXPECT_FALSE(
      LineResidual<ResidualImages::kBoth>(line, synthetic::camera(), Isometry3d::Identity()).valid);
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

template <typename Images>
class JacobianTest : public ::testing::Test {
 protected:
  using Point = PointResidual<Images::value>;
  using Line = LineResidual<Images::value>;

  const StereoCamera camera_ = synthetic::camera();
  const Correspondences all_ = synthetic::matches(camera_, synthetic::motion(), {10, 10, 2.0}, 2);
  // Not the motion of the pixels: the residuals are not zero.
  const Isometry3d T_ = synthetic::transform({0.3, -0.2, 0.25}, {0.5, -0.2, 0.4});
};

using Images = ::testing::Types<std::integral_constant<ResidualImages, ResidualImages::kLeft>,
                                std::integral_constant<ResidualImages, ResidualImages::kBoth>>;
TYPED_TEST_SUITE(JacobianTest, Images);

TYPED_TEST(JacobianTest, Point) {
  using Residual = typename TestFixture::Point;
  for (const PointCorrespondence& point : this->all_.points) {
    const auto moved = [&](const Eigen::VectorXd& d) -> Eigen::VectorXd {
      return Residual(point, this->camera_, perturbed(this->T_, d)).value;
    };
    const auto shifted = [&](const Eigen::VectorXd& d) -> Eigen::VectorXd {
      PointCorrespondence other = point;
      other.p_prev += d;
      return Residual(other, this->camera_, this->T_).value;
    };
    const Residual at(point, this->camera_, this->T_);
    ASSERT_TRUE(at.valid);
    ASSERT_GT(at.value.norm(), 1.0);
    EXPECT_LT(jacobianError(at.jacobianByMotion(), 6, moved), 1e-6);
    EXPECT_LT(jacobianError(at.jacobianByLandmark(), 3, shifted), 1e-6);
  }
}

TYPED_TEST(JacobianTest, Line) {
  using Residual = typename TestFixture::Line;
  for (const LineCorrespondence& line : this->all_.lines) {
    const auto moved = [&](const Eigen::VectorXd& d) -> Eigen::VectorXd {
      return Residual(line, this->camera_, perturbed(this->T_, d)).value;
    };
    const auto shifted = [&](const Eigen::VectorXd& d) -> Eigen::VectorXd {
      LineCorrespondence other = line;
      other.start_prev += d.head<3>();
      other.end_prev += d.tail<3>();
      return Residual(other, this->camera_, this->T_).value;
    };
    const Residual at(line, this->camera_, this->T_);
    ASSERT_TRUE(at.valid);
    ASSERT_GT(at.value.norm(), 1.0);
    EXPECT_LT(jacobianError(at.jacobianByMotion(), 6, moved), 1e-5);
    EXPECT_LT(jacobianError(at.jacobianByLandmark(), 6, shifted), 1e-5);
  }
}

// --- Cost of the solver

template <typename Images>
class MotionCostTest : public ::testing::Test {};
TYPED_TEST_SUITE(MotionCostTest, Images);

TYPED_TEST(MotionCostTest, AgreesWithNumericDerivatives) {
  using Cost = MotionCost<TypeParam::value>;
  const StereoCamera camera = synthetic::camera();
  // Distant landmarks in the middle stay in front under a large rotation about the optical axis.
  const Isometry3d ground_truth = synthetic::transform({0.1, -0.05, 2.6}, {0.1, -0.2, 1.0});
  synthetic::MatchOptions options{4, 4, 1.0};
  options.sigma_px = 100.0;  // residuals below and above the Huber threshold
  const Correspondences matches = synthetic::matches(camera, ground_truth, options, 5);
  typename Cost::Points points(matches.points, camera);
  typename Cost::Lines lines(matches.lines, camera);
  points.linearizeInformation(ground_truth, true);
  lines.linearizeInformation(ground_truth, true);
  const Cost cost(points, lines, 1.5);
  // Small angles take a branch of their own.
  for (const Vector3d& rotation : {Vector3d(0.0, 0.0, 0.0), Vector3d(1e-7, -1e-7, 0.0),
                                   Vector3d(0.05, -0.1, 0.2), Vector3d(0.15, -0.1, 2.5)}) {
    const Vector3d translation(0.3, -0.1, 0.8);
    Eigen::MatrixXd J_parameters;
    const auto residuals = [&](const Eigen::VectorXd& d) {
      const MotionVector motion{rotation + d.head<3>(), translation + d.tail<3>()};
      std::vector<double> values;
      J_parameters.resize(0, 6);
      for (int part = 0; part < Cost::kParts; ++part) {
        EXPECT_TRUE(cost.forEachResidual(
            motion.toIsometry(), part, [&](const auto& r, const auto& J, const HuberLoss&) {
              values.insert(values.end(), r.data(), r.data() + r.size());
              J_parameters.conservativeResize(J_parameters.rows() + J.rows(), 6);
              J_parameters.bottomRows(J.rows()) = J * motion.perturbationByParameters();
            }));
      }
      return Eigen::VectorXd(Eigen::Map<const Eigen::VectorXd>(values.data(), values.size()));
    };
    EXPECT_GT(residuals(Vector6d::Zero()).norm(), 1.0);
    const Eigen::MatrixXd J = J_parameters;
    ASSERT_GE(J.rows(), 16);
    EXPECT_LT(jacobianError(J, 6, residuals), 1e-5);
    const auto cost_at = [&](const Eigen::VectorXd& d) {
      const auto equations = cost({rotation + d.head<3>(), translation + d.tail<3>()});
      return Eigen::VectorXd(Eigen::VectorXd::Constant(1, equations.value().cost));
    };
    EXPECT_LT(jacobianError(cost({rotation, translation})->gradient.transpose(), 6, cost_at), 1e-5);
  }
}

TEST(HuberLoss, CostIsHalfOfHubersFunctionAndWeightItsDerivative) {
  for (const double norm : {0.0, 0.7, 1.49, 1.6, 4.0, 1000.0}) {
    const HuberLoss loss(norm * norm, 1.5);
    const double rho = norm <= 1.5 ? norm * norm : 2.0 * 1.5 * norm - 1.5 * 1.5;
    EXPECT_NEAR(loss.cost, 0.5 * rho, 1e-9 * (1.0 + rho));
    const double step = 1e-6 * (1.0 + norm * norm);
    const double slope = 2.0 * (HuberLoss(norm * norm + step, 1.5).cost - loss.cost) / step;
    EXPECT_NEAR(loss.weight, slope, 1e-5 * slope) << norm;
  }
}

}  // namespace
}  // namespace point_line_odometry
