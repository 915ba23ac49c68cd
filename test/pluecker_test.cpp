#include "point_line_odometry/pluecker.h"

#include <gtest/gtest.h>

#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::Vector4d;

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

TEST(PlueckerLine, OrderOfPointsTurnsTheLine) {
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
    const Vector3d rotation(random.uniform(-3.0, 3.0), random.uniform(-3.0, 3.0),
                            random.uniform(-3.0, 3.0));
    const Vector3d translation(random.uniform(-9.0, 9.0), random.uniform(-9.0, 9.0),
                               random.uniform(-9.0, 9.0));
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
  // A vertical line at x = 1 m, z = 5 m is seen in column 1500 / 5 + 600.
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
  // It is seen as a point: no finite distance may come out of it.
  const auto line = PlueckerLine::throughPoints(Vector3d(0.0, 0.0, 1.0), Vector3d(0.0, 0.0, 2.0));
  EXPECT_FALSE(std::isfinite(
      distanceToLine(lineProjectionMatrix(synthetic::camera()) * line.n, Vector2d(1.0, 2.0))));
}

}  // namespace
}  // namespace point_line_odometry
