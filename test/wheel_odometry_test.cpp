/// Motion priors by wheels, tf or another odometry: differences of poses, their noise, samples that
/// are missing, late, doubled, unordered, jumping or not numbers; the flat floor; fusion.

#include "point_line_odometry/wheel_odometry.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "geometry/camera_axes.h"
#include "geometry/se3.h"
#include "motion/prior_factor.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

constexpr std::int64_t kSecond = 1000000000;
constexpr std::int64_t kFrame = kSecond / 10;
constexpr std::int64_t kSample = kSecond / 50;

Isometry3d transform(const Vector3d& rotation, const Vector3d& translation) {
  Isometry3d T = Isometry3d::Identity();
  T.linear() = expSO3(rotation);
  T.translation() = translation;
  return T;
}

/// The body drives along a curve at about 2 m/s.
Isometry3d bodyAt(double t) {
  return transform({0.0, 0.0, 0.6 * std::sin(0.7 * t)}, {2.0 * t, 0.8 * std::sin(0.5 * t), 0.0});
}

/// A camera before and above the body that looks ahead and a little down.
Isometry3d cameraInBody() {
  Isometry3d T = Isometry3d::Identity();
  T.linear() = cameraAxesInBody() * expSO3({-0.2, 0.05, 0.0});
  T.translation() << 0.7, 0.1, 1.2;
  return T;
}

Isometry3d cameraMotion(std::int64_t from_ns, std::int64_t to_ns) {
  const Isometry3d from = bodyAt(1e-9 * static_cast<double>(from_ns)) * cameraInBody();
  return from.inverse() * bodyAt(1e-9 * static_cast<double>(to_ns)) * cameraInBody();
}

OdometrySample sampleAt(std::int64_t ns) {
  OdometrySample sample;
  sample.stamp_ns = ns;
  sample.T_odom_body =
      transform({0.1, -0.2, 1.0}, {5.0, 6.0, 7.0}) * bodyAt(1e-9 * static_cast<double>(ns));
  return sample;
}

std::vector<OdometrySample> samplesUntil(std::int64_t end_ns, std::int64_t period_ns = kSample) {
  std::vector<OdometrySample> samples;
  for (std::int64_t ns = kSecond + 3000000; ns < end_ns; ns += period_ns)
    samples.push_back(sampleAt(ns));
  return samples;
}

Parameters wheelParameters() {
  Parameters parameters;
  parameters.wheels.enabled = true;
  return parameters;
}

WheelOdometry filled(const std::vector<OdometrySample>& samples,
                     const Parameters& parameters = wheelParameters()) {
  WheelOdometry wheels(parameters, cameraInBody());
  for (const OdometrySample& sample : samples) wheels.add(sample);
  return wheels;
}

void expectMotion(const MotionPrior& prior, const Isometry3d& expected, double m, double rad) {
  const Vector6d difference = poseDifference(expected, prior.T_prev_curr);
  EXPECT_LT(difference.head<3>().norm(), m);
  EXPECT_LT(difference.tail<3>().norm(), rad);
  EXPECT_TRUE(isUsable(prior));
}

/// The deviation of an axis of the body by a prior of the camera; that of all others is free.
double deviation(const MotionPrior& prior, const Vector6d& axis_of_body) {
  Matrix6d bounded = prior.information;
  bounded.diagonal().array() += 1e-9;
  // Back to the body: errors of the camera's motion by those of the body's.
  const Isometry3d T_camera_body = cameraInBody().inverse();
  MotionPrior of_camera = prior;
  of_camera.information = bounded;
  const Matrix6d of_body = ofCamera(of_camera, T_camera_body).information;
  const Matrix6d covariance = of_body.inverse();
  return std::sqrt(axis_of_body.dot(covariance * axis_of_body));
}

TEST(WheelOdometry, GivesTheMotionOfTheCamera) {
  const WheelOdometry wheels = filled(samplesUntil(5 * kSecond));
  for (std::int64_t ns = 2 * kSecond; ns < 4 * kSecond; ns += kFrame) {
    const auto prior = wheels.between(ns, ns + kFrame);
    ASSERT_TRUE(prior);
    EXPECT_EQ(prior->from_ns, ns);
    EXPECT_EQ(prior->to_ns, ns + kFrame);
    expectMotion(*prior, cameraMotion(ns, ns + kFrame), 2e-4, 2e-4);
  }
  // A second, and a sample at both ends.
  const auto exact = wheels.between(kSecond + 3000000, 2 * kSecond + 3000000);
  ASSERT_TRUE(exact);
  expectMotion(*exact, cameraMotion(kSecond + 3000000, 2 * kSecond + 3000000), 1e-9, 1e-9);
}

TEST(WheelOdometry, HasTheNoiseOfTheTwistAndOfSlip) {
  std::vector<OdometrySample> samples = samplesUntil(5 * kSecond);
  for (OdometrySample& sample : samples) sample.twist_variance << 0.04, 0.01, 1e6, 1e6, 1e6, 0.0025;
  Parameters parameters = wheelParameters();
  parameters.wheels.slip_x = parameters.wheels.slip_y = parameters.wheels.slip_yaw = 0.0;
  const std::int64_t from = 2 * kSecond;
  const auto of_twist = filled(samples, parameters).between(from, from + kFrame);
  ASSERT_TRUE(of_twist);
  EXPECT_NEAR(deviation(*of_twist, Vector6d::Unit(0)), 0.2 * 0.1, 1e-3);
  EXPECT_NEAR(deviation(*of_twist, Vector6d::Unit(1)), 0.1 * 0.1, 1e-3);
  EXPECT_NEAR(deviation(*of_twist, Vector6d::Unit(5)), 0.05 * 0.1, 1e-3);
  parameters.wheels.slip_x = 0.5;
  const auto slipping = filled(samples, parameters).between(from, from + kFrame);
  const double way_m = cameraMotion(from, from + kFrame).translation().norm();
  EXPECT_NEAR(deviation(*slipping, Vector6d::Unit(0)), std::hypot(0.02, 0.5 * way_m), 0.01);
  EXPECT_NEAR(deviation(*slipping, Vector6d::Unit(1)), 0.1 * 0.1, 1e-3);
}

/// Zero, negative and NaN stand for nothing; 1e6 for an axis that is not measured.
TEST(WheelOdometry, TakesDefaultsForVariancesThatAreNone) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::int64_t from = 2 * kSecond;
  const auto withVariance = [&](double variance) {
    std::vector<OdometrySample> samples = samplesUntil(5 * kSecond);
    for (OdometrySample& sample : samples) sample.twist_variance.setConstant(variance);
    return filled(samples).between(from, from + kFrame);
  };
  const auto zero = withVariance(0.0);
  ASSERT_TRUE(zero);
  EXPECT_NEAR(deviation(*zero, Vector6d::Unit(3)), 0.3 * 0.1, 1e-3) << "it sways";
  EXPECT_NEAR(deviation(*zero, Vector6d::Unit(2)), 0.3 * 0.1, 2e-3);
  EXPECT_LT(deviation(*zero, Vector6d::Unit(0)), 0.02);
  for (const double variance : {-1.0, nan}) {
    const auto other = withVariance(variance);
    ASSERT_TRUE(other);
    EXPECT_EQ(other->information, zero->information) << variance;
  }
  EXPECT_EQ(PriorFactor(withVariance(0.01).value()).axes(), 6);
  EXPECT_FALSE(withVariance(1e6));
  EXPECT_FALSE(withVariance(std::numeric_limits<double>::infinity()));
}

TEST(WheelOdometry, KnowsNothingWithoutPosesAroundTheFrames) {
  std::vector<OdometrySample> samples = samplesUntil(3 * kSecond);
  const WheelOdometry wheels = filled(samples);
  EXPECT_FALSE(wheels.between(kSecond / 2, 2 * kSecond)) << "before the first one";
  EXPECT_FALSE(wheels.between(2 * kSecond, 3 * kSecond + kFrame)) << "after the last one";
  EXPECT_FALSE(wheels.between(2 * kSecond, 2 * kSecond));
  EXPECT_FALSE(wheels.between(2 * kSecond, 2 * kSecond - kFrame));
  EXPECT_TRUE(wheels.covers(3 * kSecond - kFrame));
  EXPECT_FALSE(wheels.covers(3 * kSecond + kFrame));
  // A hole of 0.6 s.
  samples.erase(std::remove_if(samples.begin(), samples.end(),
                               [](const OdometrySample& s) {
                                 return s.stamp_ns > 2 * kSecond &&
                                        s.stamp_ns < 2 * kSecond + 6 * kFrame;
                               }),
                samples.end());
  const WheelOdometry with_hole = filled(samples);
  EXPECT_FALSE(with_hole.between(2 * kSecond, 2 * kSecond + 8 * kFrame)) << "begins in it";
  EXPECT_FALSE(with_hole.between(kSecond + 5 * kFrame, 2 * kSecond + kFrame)) << "ends in it";
  const auto over = with_hole.between(kSecond + 5 * kFrame, 2 * kSecond + 8 * kFrame);
  ASSERT_TRUE(over) << "the poses on both sides of it are known";
  expectMotion(*over, cameraMotion(kSecond + 5 * kFrame, 2 * kSecond + 8 * kFrame), 1e-3, 1e-3);
}

TEST(WheelOdometry, DoesNotDependOnTheOrderOfItsSamples) {
  const std::vector<OdometrySample> samples = samplesUntil(4 * kSecond);
  std::vector<OdometrySample> shuffled = samples;
  std::shuffle(shuffled.begin(), shuffled.end(), std::mt19937(3));
  for (const OdometrySample& sample : samples) shuffled.push_back(sample);
  WheelOdometry mixed = filled(shuffled);
  OdometrySample bad = sampleAt(2 * kSecond + 1);
  bad.T_odom_body.translation().x() = std::numeric_limits<double>::quiet_NaN();
  mixed.add(bad);
  bad = sampleAt(2 * kSecond + 1);
  bad.T_odom_body.linear() *= 2.0;
  mixed.add(bad);
  EXPECT_EQ(mixed.faults().doubled, samples.size());
  EXPECT_EQ(mixed.faults().not_finite, 2U);
  const auto a = filled(samples).between(2 * kSecond, 2 * kSecond + kFrame);
  const auto b = mixed.between(2 * kSecond, 2 * kSecond + kFrame);
  ASSERT_TRUE(a && b);
  EXPECT_EQ(a->T_prev_curr.matrix(), b->T_prev_curr.matrix());
  EXPECT_EQ(a->information, b->information);
}

TEST(WheelOdometry, IgnoresIntervalsWithAJump) {
  std::vector<OdometrySample> samples = samplesUntil(4 * kSecond);
  for (OdometrySample& sample : samples) {
    if (sample.stamp_ns > 2 * kSecond)
      sample.T_odom_body = transform({0.0, 0.0, 0.0}, {0.3, 0.0, 0.0}) * sample.T_odom_body;
  }
  const WheelOdometry wheels = filled(samples);
  EXPECT_FALSE(wheels.between(2 * kSecond - kFrame / 2, 2 * kSecond + kFrame / 2));
  EXPECT_TRUE(wheels.between(2 * kSecond - 2 * kFrame, 2 * kSecond - kFrame));
  EXPECT_TRUE(wheels.between(2 * kSecond + kFrame, 2 * kSecond + 2 * kFrame));
}

/// Stamps that tremble are none.
TEST(WheelOdometry, TakesTremblingStampsForNoJump) {
  std::vector<OdometrySample> samples = samplesUntil(4 * kSecond);
  std::mt19937 random(5);
  for (OdometrySample& sample : samples)
    sample.stamp_ns += static_cast<std::int64_t>(random() % 12000000);
  const WheelOdometry wheels = filled(samples);
  for (std::int64_t ns = 2 * kSecond; ns < 3 * kSecond; ns += kFrame)
    EXPECT_TRUE(wheels.between(ns, ns + kFrame));
}

/// A frame whose images give a motion.
FrameResult seen(std::int64_t from_ns, std::int64_t to_ns, const Isometry3d& motion) {
  FrameResult result;
  result.stamp_ns = to_ns;
  result.state = TrackingState::kOk;
  Matrix6d covariance = Matrix6d::Identity() * 1e-8;
  result.image_motion = ImageMotion{from_ns, motion, covariance};
  return result;
}

TEST(WheelOdometry, IsSuspendedWhileItDisagreesWithTheImages) {
  WheelOdometry wheels = filled(samplesUntil(12 * kSecond));
  std::int64_t ns = 2 * kSecond;
  const auto drive = [&](int frames, double scale) {
    for (int i = 0; i < frames; ++i, ns += kFrame) {
      Isometry3d motion = cameraMotion(ns, ns + kFrame);
      motion.translation() *= scale;
      wheels.update(seen(ns, ns + kFrame, motion));
    }
  };
  drive(10, 1.0);
  EXPECT_TRUE(wheels.isTrusted());
  drive(2, 0.5);
  EXPECT_TRUE(wheels.between(ns, ns + kFrame)) << "two are an accident";
  drive(10, 0.5);
  EXPECT_FALSE(wheels.isTrusted());
  EXPECT_FALSE(wheels.between(ns, ns + kFrame));
  drive(15, 1.0);
  EXPECT_TRUE(wheels.isTrusted());
  EXPECT_TRUE(wheels.between(ns, ns + kFrame));
  for (int i = 0; i < 20; ++i) drive(1, i % 2 == 0 ? 0.5 : 1.0);
  EXPECT_FALSE(wheels.isTrusted()) << "every second one";
}

TEST(WheelOdometry, DropsOldSamplesAndIsBounded) {
  WheelOdometry wheels = filled(samplesUntil(4 * kSecond));
  wheels.clear();
  EXPECT_FALSE(wheels.between(2 * kSecond, 2 * kSecond + kFrame));
  wheels.update(seen(99 * kSecond, 100 * kSecond, Isometry3d::Identity()));
  wheels.add(sampleAt(2 * kSecond));
  EXPECT_EQ(wheels.faults().late, 1U);
}

/// For as long as fills the buffer: the samples of the right clock, which come after, are kept.
TEST(WheelOdometry, AClockThatWasAheadSilencesNothing) {
  WheelOdometry wheels(wheelParameters(), cameraInBody());
  wheels.update(seen(kSecond, 2 * kSecond, Isometry3d::Identity()));
  for (std::int64_t i = 0; i < 25000; ++i) wheels.add(sampleAt(200 * kSecond + i * 5000000));
  for (const OdometrySample& sample : samplesUntil(5 * kSecond)) wheels.add(sample);
  const auto prior = wheels.between(3 * kSecond, 3 * kSecond + kFrame);
  ASSERT_TRUE(prior);
  expectMotion(*prior, cameraMotion(3 * kSecond, 3 * kSecond + kFrame), 2e-4, 2e-4);
}

TEST(PlanarPrior, KnowsThreeAxesOfTheBody) {
  PlanarParameters parameters;
  parameters.z_deviation = 0.1;
  parameters.roll_deviation = 0.2;
  parameters.pitch_deviation = 0.3;
  const MotionPrior prior = planarPrior(parameters, cameraInBody(), kSecond, kSecond + kFrame);
  EXPECT_TRUE(isUsable(prior));
  EXPECT_EQ(PriorFactor(prior).axes(), 3);
  const double root_s = std::sqrt(0.1);
  EXPECT_NEAR(deviation(prior, Vector6d::Unit(2)), 0.1 * root_s, 1e-4);
  EXPECT_NEAR(deviation(prior, Vector6d::Unit(3)), 0.2 * root_s, 1e-4);
  EXPECT_NEAR(deviation(prior, Vector6d::Unit(4)), 0.3 * root_s, 1e-4);
  // A drive on the floor agrees with it, wherever the camera is; a climb does not.
  const auto distance = [&](const Isometry3d& T_prev_curr) {
    return PriorFactor(prior).chiSquare(T_prev_curr.inverse(), 1e-10 * Matrix6d::Identity());
  };
  const Isometry3d X = cameraInBody();
  EXPECT_LT(distance(cameraMotion(kSecond, kSecond + kFrame)), 1e-9);
  EXPECT_GT(distance(X.inverse() * transform(Vector3d::Zero(), {0.0, 0.0, 0.3}) * X), 30.0);
  EXPECT_GT(distance(X.inverse() * transform({0.0, 0.5, 0.0}, Vector3d::Zero()) * X), 20.0);
}

MotionPrior fusedOf(const MotionPrior& a, const MotionPrior& b) {
  std::vector<MotionPrior> priors;
  priors.push_back(a);
  priors.push_back(b);
  const std::optional<MotionPrior> one = fused(priors);
  EXPECT_TRUE(one);
  return one.value_or(MotionPrior());
}

/// What the floor says is not said again by the zeros of a planar odometry.
TEST(PlanarPrior, IsNotCountedTwice) {
  std::vector<OdometrySample> samples = samplesUntil(5 * kSecond);
  for (OdometrySample& sample : samples) sample.twist_variance.setConstant(0.01);
  Parameters parameters = wheelParameters();
  const std::int64_t from = 2 * kSecond;
  EXPECT_EQ(PriorFactor(filled(samples, parameters).between(from, from + kFrame).value()).axes(),
            6);
  parameters.planar.enabled = true;
  const MotionPrior wheels = filled(samples, parameters).between(from, from + kFrame).value();
  EXPECT_EQ(PriorFactor(wheels).axes(), 3);
  const MotionPrior floor = planarPrior(parameters.planar, cameraInBody(), from, from + kFrame);
  const MotionPrior both = fusedOf(wheels, floor);
  EXPECT_EQ(PriorFactor(both).axes(), 6);
  EXPECT_NEAR(deviation(both, Vector6d::Unit(2)), deviation(floor, Vector6d::Unit(2)), 1e-4);
  EXPECT_NEAR(deviation(both, Vector6d::Unit(0)), deviation(wheels, Vector6d::Unit(0)), 1e-4);
}

MotionPrior knows(const Isometry3d& motion, const Vector6d& deviations) {
  MotionPrior prior;
  prior.from_ns = kSecond;
  prior.to_ns = kSecond + kFrame;
  prior.T_prev_curr = motion;
  for (int i = 0; i < 6; ++i)
    prior.information(i, i) = deviations[i] > 0.0 ? std::pow(deviations[i], -2) : 0.0;
  return prior;
}

/// By itself: thresholds and rough ground say nothing of the wheels.
TEST(PlanarFloor, IsSuspendedWhileTheImagesDisagree) {
  PlanarFloor floor(PlanarParameters(), cameraInBody());
  std::int64_t ns = 2 * kSecond;
  const auto drive = [&](int frames, double roll) {
    for (int i = 0; i < frames; ++i, ns += kFrame) {
      const Isometry3d of_body = transform({i % 2 == 0 ? roll : -roll, 0.0, 0.0}, {0.2, 0.0, 0.0});
      floor.update(seen(ns, ns + kFrame, cameraInBody().inverse() * of_body * cameraInBody()));
    }
  };
  drive(10, 0.0);
  EXPECT_TRUE(floor.between(ns, ns + kFrame));
  drive(2, 0.2);
  EXPECT_TRUE(floor.isTrusted()) << "one threshold";
  drive(10, 0.2);
  EXPECT_FALSE(floor.isTrusted());
  EXPECT_FALSE(floor.between(ns, ns + kFrame));
  drive(20, 0.0);
  EXPECT_TRUE(floor.between(ns, ns + kFrame));
}

TEST(FusedPrior, OfOneIsThatOne) {
  EXPECT_FALSE(fused({}));
  const MotionPrior prior =
      knows(transform({0.1, 0.2, 0.3}, {1.0, 2.0, 3.0}), Vector6d::Constant(0.1));
  const std::optional<MotionPrior> same = fused(std::vector<MotionPrior>(1, prior));
  ASSERT_TRUE(same);
  EXPECT_EQ(same->T_prev_curr.matrix(), prior.T_prev_curr.matrix());
  EXPECT_EQ(same->information, prior.information);
}

TEST(FusedPrior, TakesEachAxisFromTheSourceThatKnowsIt) {
  Vector6d of_rotation = Vector6d::Zero();
  of_rotation.tail<3>().setConstant(0.001);
  Vector6d of_translation = Vector6d::Zero();
  of_translation.head<3>().setConstant(0.05);
  const Vector3d rotation(0.1, -0.2, 0.3);
  const Vector3d translation(1.0, 0.5, -0.2);
  const MotionPrior both = fusedOf(knows(transform(rotation, Vector3d::Zero()), of_rotation),
                                   knows(transform(Vector3d::Zero(), translation), of_translation));
  expectMotion(both, transform(rotation, translation), 1e-6, 1e-6);
  EXPECT_EQ(PriorFactor(both).axes(), 6);
  EXPECT_EQ(both.from_ns, kSecond);
}

TEST(FusedPrior, WeighsByTheInformation) {
  const MotionPrior a =
      knows(transform(Vector3d::Zero(), {1.0, 0.0, 0.0}), Vector6d::Constant(0.1));
  const MotionPrior b =
      knows(transform({0.0, 0.0, 0.05}, {1.3, 0.0, 0.0}), Vector6d::Constant(0.2));
  const MotionPrior ab = fusedOf(a, b);
  const MotionPrior ba = fusedOf(b, a);
  EXPECT_NEAR(ab.T_prev_curr.translation().x(), 1.06, 1e-6);
  EXPECT_NEAR(logSO3(ab.T_prev_curr.linear()).z(), 0.01, 1e-6);
  EXPECT_NEAR(ab.information(0, 0), 125.0, 1e-9);
  EXPECT_TRUE(ab.T_prev_curr.isApprox(ba.T_prev_curr, 1e-9));
}

/// Known errors of the body's motion are what the prior of the camera says they are.
TEST(PriorOfCamera, HasTheErrorsOfTheBody) {
  const Isometry3d X = cameraInBody();
  const Isometry3d motion = transform({0.02, 0.03, 0.4}, {1.0, 0.2, 0.0});
  Vector6d deviations;
  deviations << 0.01, 0.02, 0.03, 0.001, 0.002, 0.003;
  const MotionPrior prior = ofCamera(knows(motion, deviations), X);
  EXPECT_TRUE(prior.T_prev_curr.isApprox(X.inverse() * motion * X, 1e-12));
  const PriorFactor factor(prior);
  for (int i = 0; i < 6; ++i) {
    const Vector6d error = 0.5 * deviations[i] * Vector6d::Unit(i);
    const Isometry3d wrong = X.inverse() * addPoseDifference(motion, error) * X;
    EXPECT_NEAR(factor.chiSquare(wrong.inverse(), 1e-14 * Matrix6d::Identity()), 0.25, 0.01) << i;
  }
}

}  // namespace
}  // namespace point_line_odometry
