/// Motion priors in the odometry: what they add, what carries the pose without images, and what
/// becomes of wrong ones.

#include "point_line_odometry/motion_prior.h"

#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "geometry/se3.h"
#include "point_line_odometry/stereo_odometry.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using synthetic::kPeriodNs;
using synthetic::truePose;

constexpr int kFrames = 24;

std::int64_t stampOf(int k) { return (k + 1) * kPeriodNs; }

/// The true rotation from frame k-1 to k.
MotionPrior trueRotation(int k, double sigma_rad) {
  MotionPrior prior;
  prior.from_ns = stampOf(k - 1);
  prior.to_ns = stampOf(k);
  prior.T_prev_curr.linear() = truePose(k - 1).linear().transpose() * truePose(k).linear();
  prior.information.diagonal().tail<3>().setConstant(1.0 / (sigma_rad * sigma_rad));
  return prior;
}

/// The true motion from frame k-1 to k, as wheels know it: nothing of the height.
MotionPrior trueMotion(int k) {
  MotionPrior prior = trueRotation(k, 1e-3);
  prior.T_prev_curr = truePose(k - 1).inverse() * truePose(k);
  prior.information(0, 0) = prior.information(2, 2) = 1e6;
  return prior;
}

using PriorOf = std::function<std::optional<MotionPrior>(int)>;
std::optional<MotionPrior> none(int) { return std::nullopt; }

/// The room is left in the dark from frame `dark` to `light`.
struct Dark {
  int begin = kFrames;
  int end = kFrames;
};

StereoImages images(int k, const Dark& dark) {
  return k >= dark.begin && k < dark.end ? synthetic::black(stampOf(k)) : synthetic::drive(k);
}

std::vector<FrameResult> run(const PriorOf& prior_of, const Dark& dark = {},
                             const Parameters& parameters = {}) {
  StereoOdometry odometry(synthetic::roomCamera(), parameters);
  std::vector<FrameResult> results;
  for (int k = 0; k < kFrames; ++k) {
    const std::optional<MotionPrior> prior = k > 0 ? prior_of(k) : std::nullopt;
    results.push_back(odometry.process(images(k, dark), prior ? &*prior : nullptr));
  }
  return results;
}

double angleTo(const FrameResult& result, int k) {
  return rotationAngle(result.T_odom_camera.linear().transpose() * truePose(k).linear());
}

void expectSamePoses(const std::vector<FrameResult>& a, const std::vector<FrameResult>& b) {
  for (std::size_t k = 0; k < a.size(); ++k) {
    EXPECT_EQ(a[k].T_odom_camera.matrix(), b[k].T_odom_camera.matrix()) << k;
    EXPECT_EQ(a[k].state, b[k].state) << k;
  }
}

TEST(MotionPriors, AreUsedAndMakeTheMotionMoreCertain) {
  const std::vector<FrameResult> without = run(none);
  const std::vector<FrameResult> with = run([](int k) { return trueRotation(k, 1e-5); });
  for (int k = 1; k < kFrames; ++k) {
    EXPECT_EQ(without[k].prior.use, PriorUse::kNone);
    EXPECT_EQ(with[k].prior.use, PriorUse::kUsed) << k << " " << with[k].prior.chi_square;
    EXPECT_EQ(with[k].prior.axes, 3);
    EXPECT_EQ(with[k].state, TrackingState::kOk);
    ASSERT_TRUE(with[k].image_motion);
    EXPECT_EQ(with[k].image_motion->from_ns, stampOf(k - 1));
    EXPECT_LT(with[k].twist_covariance.diagonal().tail<3>().sum(),
              with[k].image_motion->covariance.diagonal().tail<3>().sum() / 0.01);
  }
  EXPECT_LT(angleTo(with.back(), kFrames - 1), angleTo(without.back(), kFrames - 1) + 1e-4);
}

/// By 5 degrees in each frame, which the images show.
TEST(MotionPriors, WrongOnesAreRejectedAndChangeNothing) {
  const auto wrong = [](int k) {
    MotionPrior prior = trueRotation(k, 1e-4);
    prior.T_prev_curr.linear() = prior.T_prev_curr.linear() * expSO3({0.0, 0.09, 0.0});
    return prior;
  };
  const std::vector<FrameResult> without = run(none);
  const std::vector<FrameResult> always = run(wrong);
  expectSamePoses(without, always);
  for (int k = 1; k <= 4; ++k) EXPECT_EQ(always[k].prior.use, PriorUse::kRejected) << k;
  for (int k = 5; k < kFrames; ++k) EXPECT_EQ(always[k].prior.use, PriorUse::kSuspended) << k;
  for (int k = 1; k < kFrames; ++k) EXPECT_GT(always[k].prior.chi_square, 100.0);
  // Each time again after good ones: rejected, not yet suspended.
  const std::vector<FrameResult> sometimes =
      run([&](int k) { return k % 8 == 0 ? wrong(k) : trueRotation(k, 1e-4); });
  for (int k = 8; k < kFrames; k += 8) EXPECT_EQ(sometimes[k].prior.use, PriorUse::kRejected);
  EXPECT_EQ(sometimes.back().prior.use, PriorUse::kUsed);
}

TEST(MotionPriors, WhatIsNoPriorIsReportedAndChangesNothing) {
  const std::vector<std::function<void(MotionPrior*)>> faults{
      [](MotionPrior* p) { p->from_ns -= kPeriodNs; }, [](MotionPrior* p) { p->to_ns += 1; },
      [](MotionPrior* p) { p->information(3, 3) = -1e4; },
      [](MotionPrior* p) { p->T_prev_curr(0, 0) = std::numeric_limits<double>::quiet_NaN(); },
      [](MotionPrior* p) { p->information(0, 5) = std::numeric_limits<double>::infinity(); }};
  const std::vector<FrameResult> without = run(none);
  const std::vector<FrameResult> with = run([&](int k) {
    MotionPrior prior = trueRotation(k, 1e-4);
    faults[static_cast<std::size_t>(k) % faults.size()](&prior);
    return prior;
  });
  expectSamePoses(without, with);
  for (int k = 1; k < kFrames; ++k) EXPECT_EQ(with[k].prior.use, PriorUse::kInvalid) << k;
}

/// 1.4 s in the dark: without a prior the camera is LOST after half a second.
TEST(MotionPriors, CarryThePoseWithoutImages) {
  const Dark dark{6, 20};
  const std::vector<FrameResult> without = run(none, dark);
  const std::vector<FrameResult> with = run([](int k) { return trueRotation(k, 1e-4); }, dark);
  EXPECT_EQ(without[19].state, TrackingState::kLost);
  for (int k = 6; k < 20; ++k) {
    EXPECT_EQ(with[k].prior.use, PriorUse::kCarried) << k;
    EXPECT_EQ(with[k].state, TrackingState::kDegraded) << k;
    EXPECT_TRUE(with[k].pose_covariance.allFinite());
  }
  EXPECT_LT(angleTo(with[19], 19), 0.01);
  EXPECT_GT(angleTo(without[19], 19), 0.1);
  const auto error_m = [](const std::vector<FrameResult>& results, int k) {
    return (results[k].T_odom_camera.translation() - truePose(k).translation()).norm();
  };
  EXPECT_LT(error_m(with, 19), 0.25 * error_m(without, 19));
  Parameters shorter;
  shorter.tracking.max_prior_prediction_s = 0.6;
  EXPECT_EQ(run([](int k) { return trueRotation(k, 1e-4); }, dark, shorter)[19].state,
            TrackingState::kLost);
}

/// Images stay as they are while the wheels drive away. With noise the driver of the camera hangs;
/// without, it is a simulated one, and the wheels slip.
FrameResult driveBeforeImagesAtRest(bool with_noise) {
  constexpr int kStart = 30;
  constexpr int kEnd = 38;
  StereoOdometry odometry(synthetic::roomCamera(), Parameters());
  StereoImages images = synthetic::drive(0);
  FrameResult result;
  for (int k = 0; k < kEnd; ++k) {
    MotionPrior prior = trueMotion(std::max(k - kStart, 1));
    prior.from_ns = stampOf(k - 1);
    prior.to_ns = stampOf(k);
    if (k < kStart) {
      prior.T_prev_curr.setIdentity();
      if (with_noise)
        images = synthetic::noisy(synthetic::stamped(synthetic::drive(0), stampOf(k)), 2.0);
    }
    result = odometry.process(synthetic::stamped(images, stampOf(k)), k > 0 ? &prior : nullptr);
    if (k > 0) {
      EXPECT_EQ(result.reason == TrackingReason::kRepeatedImages, k >= kStart && with_noise) << k;
    }
  }
  return result;
}

TEST(MotionPriors, CarryThePoseOfACameraThatHangs) {
  const FrameResult result = driveBeforeImagesAtRest(true);
  EXPECT_EQ(result.prior.use, PriorUse::kCarried);
  EXPECT_EQ(result.state, TrackingState::kDegraded);
  EXPECT_GT(result.T_odom_camera.translation().norm(), 0.5);
}

TEST(MotionPriors, DoNotOverruleASimulatedCameraAtRest) {
  const FrameResult result = driveBeforeImagesAtRest(false);
  EXPECT_EQ(result.state, TrackingState::kOk);
  EXPECT_LT(result.T_odom_estimate.translation().norm(), 0.01);
}

/// From the very first frame in the dark: no velocity is known. A gyroscope alone knows no
/// translation.
TEST(MotionPriors, CarryThePoseBeforeAnyVelocityIfTheyKnowTheTranslation) {
  const Dark dark{0, 12};
  const std::vector<FrameResult> by_wheels = run(trueMotion, dark);
  const std::vector<FrameResult> by_gyroscope =
      run([](int k) { return trueRotation(k, 1e-4); }, dark);
  for (int k = 1; k < 12; ++k) {
    EXPECT_EQ(by_wheels[k].prior.use, PriorUse::kCarried) << k;
    EXPECT_EQ(by_wheels[k].state, TrackingState::kDegraded) << k;
    EXPECT_EQ(by_gyroscope[k].prior.use, PriorUse::kNone) << k;
    EXPECT_EQ(by_gyroscope[k].state, TrackingState::kLost) << k;
    EXPECT_EQ(by_gyroscope[k].T_odom_camera.matrix(), by_gyroscope[0].T_odom_camera.matrix());
  }
  const double travelled_m = (truePose(11).translation() - truePose(0).translation()).norm();
  EXPECT_LT((by_wheels[11].T_odom_camera.translation() - truePose(11).translation()).norm(),
            0.1 * travelled_m);
}

/// A gyroscope or a flat floor does not tell how far the camera went meanwhile.
TEST(MotionPriors, OnlyTheTranslationCarriesThePoseAcrossAGap) {
  const auto across = [](const std::function<void(MotionPrior*)>& change) {
    StereoOdometry odometry(synthetic::roomCamera(), {});
    for (int k = 0; k < 6; ++k) odometry.process(images(k, {}));
    StereoImages later = synthetic::black(stampOf(5) + 50 * kPeriodNs);
    MotionPrior prior;
    prior.from_ns = stampOf(5);
    prior.to_ns = later.stamp_ns;
    change(&prior);
    const FrameResult before = odometry.process(images(5, {}));  // refused: the pose as it is
    const FrameResult result = odometry.process(later, &prior);
    const Eigen::Isometry3d step = before.T_odom_camera.inverse() * result.T_odom_camera;
    return std::make_pair(result, step.translation().norm());
  };
  const auto [by_gyroscope, turned_m] =
      across([](MotionPrior* p) { p->information.diagonal().tail<3>().setConstant(1e6); });
  EXPECT_EQ(by_gyroscope.state, TrackingState::kLost);
  EXPECT_LT(turned_m, 0.01);
  const auto [by_floor, floor_m] =
      across([](MotionPrior* p) { p->information.diagonal() << 0.0, 1e6, 0.0, 1e6, 0.0, 1e6; });
  EXPECT_EQ(by_floor.state, TrackingState::kLost);
  EXPECT_LT(floor_m, 0.01);
  const auto [by_wheels, rolled_m] = across([](MotionPrior* p) {
    p->T_prev_curr.translation().z() = 3.0;
    p->information.diagonal().setConstant(1e6);
  });
  EXPECT_EQ(by_wheels.state, TrackingState::kDegraded);
  EXPECT_NEAR(rolled_m, 3.0, 0.05);
}

/// Over a gap to what may be another place that looks alike, here as there are no landmarks, wheels
/// are believed against the images; where they agree with these, so is their covariance.
TEST(MotionPriors, TellOverAGapWhetherThePlaceIsTheSame) {
  constexpr int kLast = 3;
  constexpr int kNext = 15;
  Parameters parameters;
  parameters.window.size = 0;
  const Eigen::Isometry3d truth = synthetic::truePose(kLast).inverse() * synthetic::truePose(kNext);
  for (const double slip_m : {0.0, 1.0}) {
    StereoOdometry odometry(synthetic::roomCamera(), parameters);
    FrameResult before;
    for (int k = 0; k <= kLast; ++k) before = odometry.process(images(k, {}));
    MotionPrior wheels;
    wheels.from_ns = stampOf(kLast);
    wheels.to_ns = stampOf(kNext);
    wheels.T_prev_curr = truth;
    wheels.T_prev_curr.translation().z() += slip_m;
    // Roll and pitch are not theirs.
    wheels.information.diagonal() << 1e4, 1e4, 1e4, 0.0, 1e4, 0.0;
    const FrameResult result = odometry.process(images(kNext, {}), &wheels);
    EXPECT_EQ(result.state, TrackingState::kDegraded);
    const Eigen::Isometry3d moved = before.T_odom_estimate.inverse() * result.T_odom_estimate;
    EXPECT_NEAR((moved.translation() - wheels.T_prev_curr.translation()).norm(), 0.0, 0.05);
    EXPECT_EQ(result.prior.use, slip_m > 0.0 ? PriorUse::kCarried : PriorUse::kUsed);
    const double variance_m2 = result.estimate_covariance.diagonal().head<3>().sum();
    EXPECT_LT(variance_m2, 0.1);
  }
}

/// A camera that stands and is then carried through the dark by wheels: the pose is not kept.
TEST(MotionPriors, EndAStandstillInTheDark) {
  constexpr double kStep_m = 0.1;
  StereoOdometry odometry(synthetic::roomCamera(), {});
  int k = 0;
  FrameResult rest;
  for (; k < 12; ++k) {
    StereoImages still = synthetic::drive(0);
    still.stamp_ns = stampOf(k);
    rest = odometry.process(still);
  }
  ASSERT_TRUE(rest.twist.isZero(0.0)) << "stands";
  const auto inTheDark = [&](double step_m) {
    MotionPrior prior;
    prior.from_ns = stampOf(k - 1);
    prior.to_ns = stampOf(k);
    prior.T_prev_curr.translation().z() = step_m;
    prior.information.diagonal().setConstant(1.0 / (0.005 * 0.005));
    return odometry.process(synthetic::black(stampOf(k++)), &prior);
  };
  FrameResult result;
  for (int i = 0; i < 5; ++i) result = inTheDark(0.0);
  EXPECT_EQ(result.T_odom_camera.matrix(), rest.T_odom_camera.matrix()) << "wheels at rest";
  for (int i = 0; i < 20; ++i) result = inTheDark(kStep_m);
  EXPECT_EQ(result.state, TrackingState::kDegraded);
  EXPECT_NEAR(result.twist[2], 10.0 * kStep_m, 0.05);
  const Isometry3d moved = rest.T_odom_camera.inverse() * result.T_odom_camera;
  EXPECT_NEAR(moved.translation().z(), 20.0 * kStep_m, 0.1);
}

TEST(MotionPriors, AreInTheSavedState) {
  const Dark dark{6, 9};  // priors of dark frames are composed until the images match again
  const auto prior_of = [](int k) { return trueRotation(k, 1e-4); };
  const std::vector<FrameResult> expected = run(prior_of, dark);
  for (const int saved : {7, 9, 12}) {
    StereoOdometry first(synthetic::roomCamera(), {});
    for (int k = 0; k < saved; ++k) {
      const MotionPrior prior = prior_of(k);
      first.process(images(k, dark), k > 0 ? &prior : nullptr);
    }
    StereoOdometry second(synthetic::roomCamera(), {});
    second.restoreState(first.saveState());
    for (int k = saved; k < kFrames; ++k) {
      const MotionPrior prior = prior_of(k);
      const FrameResult result = second.process(images(k, dark), &prior);
      EXPECT_EQ(result.T_odom_camera.matrix(), expected[k].T_odom_camera.matrix()) << k;
      EXPECT_EQ(result.prior.chi_square, expected[k].prior.chi_square) << k;
    }
  }
}

}  // namespace
}  // namespace point_line_odometry
