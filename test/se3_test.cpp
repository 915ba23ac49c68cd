#include "geometry/se3.h"

#include <gtest/gtest.h>

#include <cmath>

#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Vector3d;

Vector3d someVector(double length, synthetic::Random* random) {
  const Vector3d v = random->normals<3>(1.0);
  return length * v.normalized();
}

TEST(ExpAndLog, AreInverse) {
  synthetic::Random random(1);
  for (const double angle : {0.0, 1e-12, 1e-6, 0.01, 1.0, 3.0, M_PI - 1e-6}) {
    const Vector3d w = someVector(angle, &random);
    const Eigen::Matrix3d R = expSO3(w);
    EXPECT_TRUE((R * R.transpose()).isIdentity(1e-14)) << angle;
    EXPECT_NEAR((logSO3(R) - w).norm(), 0.0, 1e-9) << angle;
    EXPECT_NEAR(rotationAngle(R), angle, 1e-9);
  }
}

TEST(ExpAndLog, KnowAQuarterTurnAboutZ) {
  Eigen::Matrix3d expected;
  expected << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  EXPECT_TRUE(expSO3(Vector3d(0, 0, M_PI_2)).isApprox(expected, 1e-15));
}

TEST(LeftJacobian, IsTheDerivativeOfExp) {
  synthetic::Random random(2);
  for (const double angle : {0.0, 1e-7, 0.1, 2.0}) {
    const Vector3d w = someVector(angle, &random);
    const Vector3d dw = someVector(1e-5, &random);
    const Vector3d turned = logSO3(expSO3(w + dw) * expSO3(w).transpose());
    EXPECT_NEAR((leftJacobian(w) * dw - turned).norm(), 0.0, 1e-9) << angle;
  }
}

TEST(PoseDifference, AddedToOnePoseGivesTheOther) {
  synthetic::Random random(3);
  for (int i = 0; i < 20; ++i) {
    Eigen::Isometry3d T_a = Eigen::Isometry3d::Identity();
    T_a.linear() = expSO3(someVector(3.0 * random.uniform(0.0, 1.0), &random));
    T_a.translation() = someVector(5.0, &random);
    Vector6d difference;
    difference << someVector(2.0, &random), someVector(1.0, &random);
    const Eigen::Isometry3d T_b = addPoseDifference(T_a, difference);
    EXPECT_NEAR((poseDifference(T_a, T_b) - difference).norm(), 0.0, 1e-12);
  }
}

TEST(PoseDifference, IsAlongAndAboutTheAxesOfOdom) {
  Eigen::Isometry3d T_a = Eigen::Isometry3d::Identity();
  T_a.linear() = expSO3(Vector3d(0, 0, M_PI_2));
  Eigen::Isometry3d T_b = T_a;
  T_b.translation() = Vector3d(1, 0, 0);
  T_b.linear() = expSO3(Vector3d(0.1, 0, 0)) * T_a.linear();
  Vector6d expected;
  expected << 1, 0, 0, 0.1, 0, 0;
  EXPECT_TRUE(poseDifference(T_a, T_b).isApprox(expected, 1e-12));
}

TEST(Adjoint, OfAProductIsTheProduct) {
  synthetic::Random random(4);
  const Eigen::Isometry3d T_a_b = addPoseDifference(
      synthetic::motion(),
      (Vector6d() << someVector(1.0, &random), someVector(1.0, &random)).finished());
  const Eigen::Isometry3d T_b_c = synthetic::motion();
  EXPECT_TRUE(adjoint(T_a_b * T_b_c).isApprox(adjoint(T_a_b) * adjoint(T_b_c), 1e-12));
}

TEST(Adjoint, RotationOfTheBaseTranslatesTheCamera) {
  Eigen::Isometry3d T_base_camera = Eigen::Isometry3d::Identity();
  T_base_camera.translation() = Eigen::Vector3d(1, 0, 0);
  Vector6d camera;
  camera << 0, 1, 0, 0, 0, 1;  // 1 m ahead of a base that turns left at 1 rad/s
  Vector6d base;
  base << 0, 0, 0, 0, 0, 1;
  EXPECT_TRUE((adjoint(T_base_camera) * camera).isApprox(base, 1e-12));
}

TEST(Adjoint, RotatesOpticalAxesToBodyAxes) {
  Eigen::Isometry3d T_base_camera = Eigen::Isometry3d::Identity();
  T_base_camera.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  Vector6d camera;
  camera << 0, 0, 2, 0, -0.5, 0;  // forward at 2 m/s, to the left at 0.5 rad/s
  Vector6d base;
  base << 2, 0, 0, 0, 0, 0.5;
  EXPECT_TRUE((adjoint(T_base_camera) * camera).isApprox(base, 1e-12));
}

TEST(BasePoseCovariance, PropagatesHeadingErrorsToThePosition) {
  Eigen::Isometry3d T_camera_base = Eigen::Isometry3d::Identity();
  T_camera_base.translation() = Eigen::Vector3d(-2, 0, 0);
  Matrix6d camera = Matrix6d::Zero();
  camera(5, 5) = 0.01;  // about z
  Eigen::Isometry3d T_odom_camera = Eigen::Isometry3d::Identity();
  const Matrix6d base = composeCovariance(T_odom_camera, camera, T_camera_base, Matrix6d::Zero());
  EXPECT_NEAR(base(1, 1), 0.04, 1e-12);
  EXPECT_NEAR(base(0, 0), 0.0, 1e-12);
  EXPECT_NEAR(base(1, 5), -0.02, 1e-12);
  EXPECT_NEAR(base(5, 5), 0.01, 1e-12);

  T_odom_camera.linear() =
      Eigen::AngleAxisd(std::acos(0.0), Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const Matrix6d turned = composeCovariance(T_odom_camera, camera, T_camera_base, Matrix6d::Zero());
  EXPECT_NEAR(turned(0, 0), 0.04, 1e-12);
  EXPECT_NEAR(turned(1, 1), 0.0, 1e-12);
}

}  // namespace
}  // namespace point_line_odometry
