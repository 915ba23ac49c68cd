/// Motion priors by a gyroscope: integration, estimation of bias and time offset, and samples that
/// are missing, late, doubled, unordered, saturated or not numbers.

#include "point_line_odometry/gyroscope.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <vector>

#include "geometry/se3.h"

namespace point_line_odometry {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr std::int64_t kSecond = 1000000000;
constexpr std::int64_t kFrame = kSecond / 20;
constexpr std::int64_t kSample = kSecond / 200;

/// The turning camera: rotation vector about changing axes, and its rate by differences.
Matrix3d R_world_imu(double t) {
  return expSO3({0.3 * std::sin(1.7 * t), 0.0, 0.0}) * expSO3({0.0, 0.4 * std::sin(2.3 * t), 0.0}) *
         expSO3({0.0, 0.0, 0.5 * t + 0.2 * std::sin(3.1 * t)});
}

Vector3d rate(double t) {
  constexpr double kStep = 1e-4;
  return logSO3(R_world_imu(t - kStep).transpose() * R_world_imu(t + kStep)) / (2.0 * kStep);
}

double seconds(std::int64_t ns) { return 1e-9 * static_cast<double>(ns); }

const Matrix3d kR_camera_imu = expSO3({0.3, -1.2, 0.7});

struct GroundTruth {
  Vector3d bias = Vector3d::Zero();
  double offset_s = 0.0;
  double noise = 0.0;  ///< [rad/s/sqrt(Hz)]
};

std::vector<ImuSample> samplesUntil(double end_s, const GroundTruth& truth,
                                    std::int64_t period_ns = kSample) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  std::vector<ImuSample> samples;
  const double deviation = truth.noise / std::sqrt(seconds(period_ns));
  for (std::int64_t ns = -kSecond; seconds(ns) < end_s; ns += period_ns) {
    ImuSample sample;
    sample.stamp_ns = 100 * kSecond + ns + std::llround(1e9 * truth.offset_s);
    sample.angular_velocity = rate(seconds(ns)) + truth.bias;
    for (int i = 0; i < 3; ++i) sample.angular_velocity[i] += deviation * normal(random);
    samples.push_back(sample);
  }
  return samples;
}

std::int64_t stampOf(int frame) { return 100 * kSecond + frame * kFrame; }

Matrix3d trueRotation(int from, int to) {
  return kR_camera_imu * R_world_imu(seconds(from * kFrame)).transpose() *
         R_world_imu(seconds(to * kFrame)) * kR_camera_imu.transpose();
}

/// What the images of a frame give.
FrameResult imageRotation(int frame, double sigma_rad, std::mt19937* random) {
  std::normal_distribution<double> normal(0.0, sigma_rad);
  Vector3d error;
  for (int i = 0; i < 3; ++i) error[i] = normal(*random);
  FrameResult result;
  result.stamp_ns = stampOf(frame);
  result.state = TrackingState::kOk;
  result.reason = TrackingReason::kNone;
  result.twist.setOnes();
  ImageMotion motion;
  motion.from_ns = stampOf(frame - 1);
  motion.T_prev_curr.linear() = expSO3(error) * trueRotation(frame - 1, frame);
  motion.covariance.diagonal().setConstant(sigma_rad * sigma_rad);
  result.image_motion = motion;
  return result;
}

/// A gyroscope calibrated by images for a time.
Gyroscope calibrated(const GroundTruth& truth, int frames, ImuParameters parameters = {}) {
  parameters.enabled = true;
  Gyroscope gyroscope(parameters, kR_camera_imu);
  std::mt19937 random(3);
  const std::vector<ImuSample> samples = samplesUntil(seconds(frames * kFrame) + 1.0, truth);
  std::size_t next = 0;
  for (int k = 1; k <= frames; ++k) {
    while (!gyroscope.covers(stampOf(k))) gyroscope.add(samples.at(next++));
    gyroscope.update(imageRotation(k, 3e-4, &random));
  }
  for (; next < samples.size(); ++next) gyroscope.add(samples[next]);
  return gyroscope;
}

void expectPrior(const std::optional<MotionPrior>& prior, int from, int to, double tolerance_rad) {
  ASSERT_TRUE(prior);
  EXPECT_LT(rotationAngle(prior->T_prev_curr.linear() * trueRotation(from, to).transpose()),
            tolerance_rad);
  EXPECT_EQ(prior->T_prev_curr.translation(), Vector3d::Zero());
  EXPECT_TRUE(prior->information.topRows<3>().isZero(0.0));
  EXPECT_GT(prior->information(3, 3), 0.0);
}

TEST(Gyroscope, IntegratesBetweenTheStampsOfFrames) {
  ImuParameters exact;
  exact.estimate_time_offset = false;
  for (const std::int64_t period : {kSample, kSecond / 1000, kSecond / 97}) {
    Gyroscope gyroscope(exact, kR_camera_imu);
    EXPECT_FALSE(gyroscope.between(stampOf(0), stampOf(1)));
    for (const ImuSample& sample : samplesUntil(3.0, {}, period)) gyroscope.add(sample);
    const double tolerance = 3.0 * std::pow(seconds(period), 2);
    expectPrior(gyroscope.between(stampOf(0), stampOf(1)), 0, 1, tolerance);
    expectPrior(gyroscope.between(stampOf(3), stampOf(40)), 3, 40, 3.0 * tolerance);
  }
}

TEST(Gyroscope, GivenTimeOffsetIsUsed) {
  ImuParameters parameters;
  parameters.estimate_time_offset = false;
  parameters.time_offset_s = 0.02;
  Gyroscope gyroscope(parameters, kR_camera_imu);
  for (const ImuSample& sample : samplesUntil(2.0, {Vector3d::Zero(), 0.02, 0.0}))
    gyroscope.add(sample);
  expectPrior(gyroscope.between(stampOf(0), stampOf(10)), 0, 10, 1e-4);
}

TEST(Gyroscope, BiasAndTimeOffsetAreEstimated) {
  for (const double offset_s : {-0.045, -0.01, 0.0, 0.03, 0.045}) {
    const GroundTruth truth{{0.05, -0.08, 0.02}, offset_s, 1.7e-4};
    const Gyroscope gyroscope = calibrated(truth, 200);
    const GyroscopeCalibration calibration = gyroscope.calibration();
    EXPECT_LT((calibration.bias - truth.bias).cwiseAbs().maxCoeff(), 1.5e-3) << offset_s;
    EXPECT_NEAR(calibration.time_offset_s, offset_s, 2e-3);
    EXPECT_LT(calibration.time_offset_sigma_s, 2e-3);
    // Three seconds without images.
    expectPrior(gyroscope.between(stampOf(200), stampOf(215)), 200, 215, 2e-3);
  }
}

/// The errors of priors, normalised by their information (NEES), have the expectation 3.
TEST(Gyroscope, PriorsAreAsUncertainAsTheySay) {
  double sum = 0.0;
  int count = 0;
  for (int i = 0; i < 12; ++i) {
    const GroundTruth truth{0.01 * Vector3d(i % 5 - 2, i % 3 - 1, i % 4 - 2), 0.004 * (i % 7 - 3),
                            1.7e-4};
    const Gyroscope gyroscope = calibrated(truth, 60);
    const auto prior = gyroscope.between(stampOf(60), stampOf(65));
    ASSERT_TRUE(prior);
    const Vector3d error = logSO3(trueRotation(60, 65) * prior->T_prev_curr.linear().transpose());
    sum += error.dot(prior->information.bottomRightCorner<3, 3>() * error);
    ++count;
  }
  EXPECT_LT(sum / count, 6.0) << "overconfident";
  EXPECT_GT(sum / count, 0.1);
}

TEST(Gyroscope, OrderOfArrivalHasNoEffect) {
  const std::vector<ImuSample> samples = samplesUntil(2.0, {{0.01, 0.0, 0.0}, 0.0, 1e-3});
  std::vector<ImuSample> shuffled = samples;
  std::shuffle(shuffled.begin(), shuffled.end(), std::mt19937(5));
  Gyroscope in_order({}, kR_camera_imu);
  Gyroscope unordered({}, kR_camera_imu);
  for (const ImuSample& sample : samples) in_order.add(sample);
  for (const ImuSample& sample : shuffled) {
    unordered.add(sample);
    unordered.add(sample);  // twice
  }
  const auto a = in_order.between(stampOf(1), stampOf(9));
  const auto b = unordered.between(stampOf(1), stampOf(9));
  ASSERT_TRUE(a && b);
  EXPECT_EQ(a->T_prev_curr.matrix(), b->T_prev_curr.matrix());
  EXPECT_EQ(a->information, b->information);
  EXPECT_EQ(unordered.faults().doubled, samples.size());
}

TEST(Gyroscope, WithoutSamplesThereIsNoPrior) {
  const auto after = [](const std::function<void(std::vector<ImuSample>*)>& spoil) {
    std::vector<ImuSample> samples = samplesUntil(2.0, {});
    spoil(&samples);
    Gyroscope gyroscope({}, kR_camera_imu);
    for (const ImuSample& sample : samples) gyroscope.add(sample);
    return gyroscope.between(stampOf(10), stampOf(12)).has_value();
  };
  const auto at = [](double seconds_after_start) {  // index of a sample
    return static_cast<std::ptrdiff_t>((1.0 + seconds_after_start) * 200.0);
  };
  EXPECT_TRUE(after([](auto*) {}));
  EXPECT_FALSE(after([](auto* s) { s->clear(); }));
  EXPECT_FALSE(after([&](auto* s) { s->resize(static_cast<std::size_t>(at(0.55))); }));
  EXPECT_FALSE(after([&](auto* s) { s->erase(s->begin(), s->begin() + at(0.53)); }));
  EXPECT_FALSE(after([&](auto* s) { s->erase(s->begin() + at(0.4), s->begin() + at(0.57)); }));
  EXPECT_TRUE(after([&](auto* s) { s->erase(s->begin() + at(0.55)); })) << "one is missing";
  EXPECT_FALSE(after([&](auto* s) { (*s)[at(0.55)].angular_velocity.x() = 17.45; })) << "saturated";
  EXPECT_TRUE(after([&](auto* s) {
    (*s)[at(0.55)].angular_velocity.x() = std::numeric_limits<double>::quiet_NaN();
  }));
  EXPECT_TRUE(after([&](auto* s) { (*s)[at(1.5)].angular_velocity.x() = 17.45; })) << "later";
}

/// Axes that are wrong by 90 degrees teach nothing; with the right ones it is trusted again.
TEST(Gyroscope, WrongAxesAreNotTrusted) {
  Gyroscope gyroscope({}, kR_camera_imu * expSO3({M_PI / 2.0, 0.0, 0.0}));
  std::mt19937 random(3);
  for (const ImuSample& sample : samplesUntil(12.0, {})) gyroscope.add(sample);
  const auto drive = [&](int begin, int end) {
    for (int k = begin; k < end; ++k) gyroscope.update(imageRotation(k, 3e-4, &random));
  };
  drive(1, 100);
  EXPECT_FALSE(gyroscope.isTrusted());
  EXPECT_FALSE(gyroscope.between(stampOf(99), stampOf(100)));
  EXPECT_FALSE(gyroscope.forceBetween(stampOf(99), stampOf(100)));
  EXPECT_TRUE(gyroscope.calibration().bias.allFinite());
  EXPECT_LT(gyroscope.calibration().bias.norm(), 3.0);
  gyroscope.setMounting(kR_camera_imu);
  drive(100, 200);
  EXPECT_TRUE(gyroscope.isTrusted());
  EXPECT_TRUE(gyroscope.between(stampOf(199), stampOf(200)));
}

TEST(Gyroscope, NeedsNoAccelerometer) {
  Gyroscope gyroscope({}, kR_camera_imu);
  for (ImuSample sample : samplesUntil(2.0, {})) {
    sample.acceleration.setConstant(std::numeric_limits<double>::quiet_NaN());
    gyroscope.add(sample);
  }
  EXPECT_EQ(gyroscope.faults().not_finite, 0U);
  EXPECT_GT(gyroscope.faults().without_acceleration, 0U);
  EXPECT_TRUE(gyroscope.between(stampOf(1), stampOf(2)));
  EXPECT_FALSE(gyroscope.forceBetween(stampOf(1), stampOf(2)));
}

/// What is learnt of the bias does not depend on the camera or on the time offset.
TEST(Gyroscope, KeepsItsBiasWithAnotherMountingAndOffset) {
  GroundTruth truth;
  truth.bias = {0.05, -0.03, 0.02};
  ImuParameters parameters;
  Gyroscope gyroscope(parameters, kR_camera_imu);
  std::mt19937 random(3);
  for (const ImuSample& sample : samplesUntil(6.0, truth)) gyroscope.add(sample);
  for (int k = 1; k <= 100; ++k) gyroscope.update(imageRotation(k, 3e-4, &random));
  const Vector3d before = gyroscope.calibration().bias;
  EXPECT_LT((before - truth.bias).norm(), 5e-3);
  gyroscope.setMounting(Matrix3d::Identity());
  parameters.time_offset_s = 0.01;
  gyroscope.setParameters(parameters);
  EXPECT_EQ(gyroscope.calibration().bias, before);
  EXPECT_EQ(gyroscope.calibration().time_offset_s, 0.01);
  EXPECT_TRUE(gyroscope.between(stampOf(101), stampOf(102))) << "samples are kept";
}

TEST(Gyroscope, KeepsABoundedNumberOfSamples) {
  Gyroscope gyroscope({}, kR_camera_imu);
  std::mt19937 random(3);
  for (int k = 1; k < 2000; ++k) {
    for (int i = 0; i < 10; ++i) {
      ImuSample sample;
      sample.stamp_ns = stampOf(k) + i * kSample;
      gyroscope.add(sample);
    }
    FrameResult result;
    result.stamp_ns = stampOf(k);
    result.reason = TrackingReason::kTooFewMatches;
    gyroscope.update(result);
  }
  EXPECT_FALSE(gyroscope.between(stampOf(1000), stampOf(1001))) << "discarded";
  EXPECT_TRUE(gyroscope.between(stampOf(1990), stampOf(1991)));
  ImuSample old;
  old.stamp_ns = stampOf(100);
  gyroscope.add(old);
  EXPECT_EQ(gyroscope.faults().late, 1U);
}

/// The samples that come after it serve as if it had not come.
TEST(Gyroscope, ASampleFromTheFarFutureEndsNoInterval) {
  Gyroscope gyroscope(ImuParameters(), Matrix3d::Identity());
  ImuSample wrong;
  wrong.stamp_ns = std::int64_t{4294967295} * 1000000000;
  gyroscope.add(wrong);
  EXPECT_FALSE(gyroscope.covers(stampOf(1)));
  for (const ImuSample& sample : samplesUntil(seconds(2 * kFrame), {})) gyroscope.add(sample);
  EXPECT_TRUE(gyroscope.covers(stampOf(1)));
  EXPECT_TRUE(gyroscope.between(stampOf(0), stampOf(1)));
}

/// For as long as fills the buffer: the samples of the right clock, which come after, are kept.
TEST(Gyroscope, AClockThatWasAheadSilencesNothing) {
  Gyroscope gyroscope(ImuParameters(), Matrix3d::Identity());
  FrameResult result;
  result.stamp_ns = stampOf(0);
  gyroscope.update(result);
  for (std::int64_t i = 0; i < 25000; ++i) {
    ImuSample ahead;
    ahead.stamp_ns = stampOf(0) + 200000000000 + i * 5000000;
    gyroscope.add(ahead);
  }
  for (const ImuSample& sample : samplesUntil(seconds(2 * kFrame), {})) gyroscope.add(sample);
  EXPECT_TRUE(gyroscope.between(stampOf(0), stampOf(1)));
}

}  // namespace
}  // namespace point_line_odometry
