
#include "motion/online_stereo_calibration.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "motion/correspondence.h"
#include "motion/motion_estimator.h"
#include "point_line_odometry/stereo_correction.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kSigmaPx = 0.2;
constexpr double kNoisySigmaPx = 2.5;

/// The pixel in a right camera with an error of a pixel in a correct one.
Vector2d distorted(const StereoCorrection& error, const Vector2d& right_px) {
  const StereoCorrection::Coefficients terms = error.terms(right_px);
  return right_px + Vector2d(error.u.dot(terms), error.v.dot(terms));
}

/// Frames of a camera whose right image has a known error, calibrated as by the odometry.
class DistortedDrive {
 public:
  explicit DistortedDrive(unsigned seed, double sigma_px = kSigmaPx)
      : sigma_px_(sigma_px), random_(seed) {}

  /// The vertical disparities of one frame's stereo matches.
  void addVerticalDisparities() {
    std::vector<OnlineStereoCalibration::VerticalDisparity> samples;
    for (int i = 0; i < 200; ++i) {
      const Vector3d p = synthetic::visiblePoint(camera, &random_);
      const Vector2d seen = distorted(error, camera.projectRight(p)) + noise();
      samples.push_back({seen, seen.y() - (camera.projectLeft(p) + noise()).y()});
    }
    calibration.addVerticalDisparities(samples, sigma_px_);
  }

  void addMotion(const std::optional<double>& share_of_new = 1.0) {
    calibration.addMotion(motion(), share_of_new);
  }

  /// What a frame's motion shows, estimated with the correction so far.
  CalibrationEvidence motion() {
    const Vector3d translation{random_.uniform(-0.1, 0.1), random_.uniform(-0.1, 0.1),
                               random_.uniform(-1.2, -0.6)};
    const Vector3d rotation{random_.uniform(-0.02, 0.02), random_.uniform(-0.05, 0.05),
                            random_.uniform(-0.02, 0.02)};
    const Isometry3d ground_truth = synthetic::transform(rotation, translation);
    const auto corrected = [&](const Vector3d& p) {
      return calibration.correction().apply(distorted(error, camera.projectRight(p)) + noise());
    };
    Correspondences matches;
    for (int i = 0; i < 200; ++i) {
      const Vector3d p = synthetic::visiblePoint(camera, &random_);
      const auto triangulated = triangulatePoint(camera, camera.projectLeft(p) + noise(),
                                                 corrected(p).x(), sigma_px_, 0.1);
      if (!triangulated || (ground_truth * p).z() < 1.0) continue;
      PointCorrespondence match;
      match.p_prev = triangulated->p_camera;
      match.covariance = triangulated->covariance;
      match.left_px = camera.projectLeft(ground_truth * p) + noise();
      match.right_px = corrected(ground_truth * p);
      match.sigma_px = sigma_px_;
      matches.points.push_back(match);
    }
    const MotionEstimate motion = estimateMotion(matches, camera, ground_truth, {});
    EXPECT_TRUE(motion.ok());
    const auto evidence =
        calibrationEvidence(matches, motion, {}, camera, calibration.correction());
    EXPECT_TRUE(evidence);
    return evidence.value_or(CalibrationEvidence());
  }

  /// What the correction leaves of the displacement of this pixel of a correct right image.
  Vector2d displacementLeft(const Vector2d& right_px) const {
    return calibration.correction().apply(distorted(error, right_px)) - right_px;
  }

  /// The displacement by a yaw that moves the principal point by so much.
  StereoCorrection::Coefficients byYaw(double px) const {
    const double k = 0.5 * camera.width / camera.fx;
    StereoCorrection::Coefficients u;
    u << px * (1.0 + k * k / 3.0), 0.0, 0.0, px * k * k, 0.0, 0.0, 0.0;
    return u;
  }

  const StereoCamera camera = synthetic::camera();
  StereoCorrection error{camera};
  OnlineStereoCalibration calibration{camera};

 private:
  Vector2d noise() { return {random_.normal(sigma_px_), random_.normal(sigma_px_)}; }

  double sigma_px_;
  synthetic::Random random_;
};

/// Of images that were scaled to a half for the odometry, in pixels of those received.
TEST(StereoCorrection, TheRootMeanSquareIsThatOfTheWholeImage) {
  StereoCamera camera = synthetic::roomCamera();
  camera.cx = 0.5 * camera.width;
  camera.cy = 0.5 * camera.height;
  StereoCamera half = camera;
  for (double* value : {&half.fx, &half.fy, &half.cx, &half.cy}) *value *= 0.5;
  half.width /= 2;
  half.height /= 2;
  StereoCorrection correction(half);
  EXPECT_EQ(correction.rmsPx(camera), Eigen::Vector2d(0.0, 0.0));
  correction.u[0] = -1.5;
  correction.v[2] = 1.0;
  const double half_height = static_cast<double>(half.height) / half.width;
  const Eigen::Vector2d expected(1.5, half_height / std::sqrt(3.0));
  EXPECT_TRUE(correction.rmsPx(half).isApprox(expected, 0.01));
  EXPECT_TRUE(correction.rmsPx(camera).isApprox(2.0 * expected, 0.01));
  EXPECT_TRUE(correction.meanPx(camera).isApprox(Eigen::Vector2d(-3.0, 0.0)));
  correction.u << 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.5;
  EXPECT_NEAR(correction.meanPx(half).x(), 0.1, 0.005) << "of x^4 / 2";
  EXPECT_EQ(StereoCorrection().rmsPx(camera), Eigen::Vector2d(0.0, 0.0)) << "of no camera";
}

TEST(StereoCorrection, TermsAreThoseOfTheHeader) {
  const StereoCamera camera = synthetic::camera();
  const StereoCorrection correction(camera);
  // x is 1 half an image's width right of the principal point; y has the same unit.
  StereoCorrection::Coefficients expected;
  expected << 1.0, 1.0, 0.5, 2.0 / 3.0, 0.5, 0.25, 1.0;
  EXPECT_LT((correction.terms({camera.cx + 320.0, camera.cy + 160.0}) - expected).norm(), 1e-12);
  expected << 1.0, -0.5, 0.0, -1.0 / 12.0, 0.0, 0.0, 1.0 / 16.0;
  EXPECT_LT((correction.terms({camera.cx - 160.0, camera.cy}) - expected).norm(), 1e-12);
  expected << 1.0, 0.0, 0.0, -1.0 / 3.0, 0.0, 0.0, 0.0;
  EXPECT_LT((correction.terms({camera.cx, camera.cy}) - expected).norm(), 1e-12);
}

TEST(StereoCorrection, DefaultIsZero) {
  EXPECT_EQ(StereoCorrection().apply({123.0, 45.0}), Vector2d(123.0, 45.0));
  EXPECT_EQ(StereoCorrection(synthetic::camera()).apply({123.0, 45.0}), Vector2d(123.0, 45.0));
}

TEST(StereoCorrection, RemovesTheDisplacement) {
  StereoCorrection correction(synthetic::camera());
  correction.u(0) = 0.25;
  correction.v(1) = -0.5;
  const Vector2d moved = correction.apply({synthetic::camera().cx + 320.0, 100.0});
  EXPECT_NEAR(moved.x(), synthetic::camera().cx + 320.0 - 0.25, 1e-12);
  EXPECT_NEAR(moved.y(), 100.5, 1e-12);
}

TEST(OnlineStereoCalibration, VerticalOffsetIsEstimatedWithinAFewFrames) {
  DistortedDrive drive(1);
  drive.error.v << 0.3, -0.25, 0.2, 0.15, -0.2, 0.1, -0.1;
  for (int frame = 0; frame < 10; ++frame) drive.addVerticalDisparities();
  EXPECT_LT((drive.calibration.correction().v - drive.error.v).cwiseAbs().maxCoeff(), 0.12);
  EXPECT_NEAR(drive.calibration.correction().u(2), 0.1, 0.1) << "a roll is one cause of such rows";
  for (int frame = 0; frame < 90; ++frame) drive.addVerticalDisparities();
  EXPECT_LT((drive.calibration.correction().v - drive.error.v).cwiseAbs().maxCoeff(), 0.03);
}

/// The rows show how the right camera is turned about its axis and tilted, and how its focal length
/// differs, and so what that does to the columns, before the camera has moved.
TEST(OnlineStereoCalibration, RollPitchAndFocalLengthAreCorrectedInBothCoordinates) {
  const StereoCamera camera = synthetic::camera();
  const Vector3d baseline(camera.baseline_m, 0.0, 0.0);
  const Vector2d centre(camera.cx, camera.cy);
  for (const auto& [rotation, focal_length] : {std::pair{Vector3d(0.0, 0.0, 0.005), 1.0},
                                               {Vector3d(0.003, 0.0, 0.0), 1.0},
                                               {Vector3d(-0.002, 0.0, -0.003), 1.0},
                                               {Vector3d(0.0, 0.0, 0.0), 1.004},
                                               {Vector3d(0.002, 0.0, -0.003), 0.996}}) {
    const Isometry3d turn = synthetic::transform(rotation, Vector3d::Zero());
    const double scale = focal_length;
    const auto seen = [&, turn, scale](const Vector3d& p) -> Vector2d {
      return centre + scale * (camera.projectRight(turn * (p - baseline) + baseline) - centre);
    };
    OnlineStereoCalibration calibration(camera);
    synthetic::Random random(5);
    std::vector<OnlineStereoCalibration::VerticalDisparity> samples;
    for (int i = 0; i < 500; ++i) {
      const Vector3d p = synthetic::visiblePoint(camera, &random);
      samples.push_back({seen(p), seen(p).y() - camera.projectLeft(p).y()});
    }
    for (int frame = 0; frame < 10; ++frame) calibration.addVerticalDisparities(samples, kSigmaPx);
    double largest_px = 0.0;
    double remaining_px = 0.0;
    for (int i = 0; i < 100; ++i) {
      const Vector3d p = synthetic::visiblePoint(camera, &random);
      const Vector2d correct = camera.projectRight(p);
      largest_px = std::max(largest_px, std::abs(seen(p).x() - correct.x()));
      remaining_px = std::max(
          remaining_px, (calibration.correction().apply(seen(p)) - correct).cwiseAbs().maxCoeff());
    }
    EXPECT_GT(largest_px, 0.2) << rotation.transpose();
    EXPECT_LT(remaining_px, 0.1 * largest_px) << rotation.transpose();
  }
}

/// Few matches in a corner of the image, of a correct camera.
TEST(OnlineStereoCalibration, NoiseOfFewRowsIsNoRotation) {
  const StereoCamera camera = synthetic::camera();
  for (unsigned seed = 0; seed < 20; ++seed) {
    synthetic::Random random(seed);
    std::vector<OnlineStereoCalibration::VerticalDisparity> samples;
    for (int i = 0; i < 10; ++i) {
      const Vector2d seen(random.uniform(500.0, 640.0), random.uniform(0.0, 100.0));
      samples.push_back({seen, random.normal(kSigmaPx)});
    }
    OnlineStereoCalibration calibration(camera);
    calibration.addVerticalDisparities(samples, kSigmaPx);
    EXPECT_LT(calibration.correction().u.cwiseAbs().maxCoeff(), 0.1) << seed;
  }
}

/// Lenses and another principal point displace rows, too.
TEST(OnlineStereoCalibration, OtherErrorsOfTheRowsAreNoRotation) {
  DistortedDrive drive(4);
  drive.error.v << 0.2, 0.2, 0.3, -0.4, 2.0, 0.5, 0.0;
  for (int frame = 0; frame < 100; ++frame) drive.addVerticalDisparities();
  EXPECT_LT((drive.calibration.correction().v - drive.error.v).cwiseAbs().maxCoeff(), 0.05);
  EXPECT_EQ(drive.calibration.correction().u, StereoCorrection::Coefficients::Zero());
}

TEST(OnlineStereoCalibration, VerticalOffsetIsRobustToWrongMatches) {
  DistortedDrive drive(2);
  synthetic::Random random(3);
  for (int frame = 0; frame < 30; ++frame) {
    drive.addVerticalDisparities();
    std::vector<OnlineStereoCalibration::VerticalDisparity> wrong;
    for (int i = 0; i < 20; ++i)
      wrong.push_back({{random.uniform(0.0, 640.0), random.uniform(0.0, 480.0)}, 2.0});
    drive.calibration.addVerticalDisparities(wrong, kSigmaPx);
  }
  EXPECT_LT(drive.calibration.correction().v.cwiseAbs().maxCoeff(), 0.2);
}

TEST(OnlineStereoCalibration, DisparityOffsetIsEstimatedFromTheMotion) {
  // The terms x and x^2 - 1/3, those of a rotated or badly calibrated right camera.
  DistortedDrive drive(4);
  drive.error.u << 0.0, 0.25, 0.0, -0.3, 0.0, 0.0, 0.0;
  for (int frame = 0; frame < 60; ++frame) drive.addMotion();
  const StereoCorrection::Coefficients u = drive.calibration.correction().u;
  EXPECT_NEAR(u(1), 0.25, 0.08);
  EXPECT_NEAR(u(3), -0.3, 0.08);
  EXPECT_EQ(drive.calibration.correction().v, StereoCorrection::Coefficients::Zero());
}

/// As KITTI's images; x^2 alone would leave 0.2 px of it in between.
TEST(OnlineStereoCalibration, TheImagesSidesAreEstimatedFromTheMotion) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    DistortedDrive drive(seed);
    drive.error.u(6) = 2.0;
    for (int frame = 0; frame < 30; ++frame) drive.addMotion();
    for (const double x : {-0.9, -0.5, 0.0, 0.5, 0.9}) {
      const Vector2d right_px(drive.camera.cx + 320.0 * x, drive.camera.cy);
      EXPECT_NEAR(drive.displacementLeft(right_px).x(), 0.0, 0.1) << seed << ", " << x;
    }
  }
}

/// Of lenses displaced by 3 px, with a yaw such that the disparities of the central row are right.
TEST(OnlineStereoCalibration, WhatLensesDoToRowsTheyMayDoToColumns) {
  constexpr double kTangentialPx = -3.0;
  const auto left_px = [](bool with_rows) {
    DistortedDrive drive(4);
    drive.error.u(5) = kTangentialPx;
    drive.error.v(4) = -kTangentialPx;
    for (int frame = 0; frame < 30; ++frame) {
      if (with_rows) drive.addVerticalDisparities();
      drive.addMotion();
    }
    return std::abs(drive.calibration.correction().u(5) - kTangentialPx);
  };
  EXPECT_LT(left_px(true), 0.2);
  EXPECT_GT(left_px(false), 0.4) << "held as of a calibrated camera";
}

/// A yaw displaces rows, too: y^2 is no less held for it. RMS of ten seeds.
TEST(OnlineStereoCalibration, RowsThatAYawDisplacesShowNoLens) {
  constexpr int kSeeds = 10;
  double squares = 0.0;
  for (unsigned seed = 0; seed < kSeeds; ++seed) {
    DistortedDrive drive(seed);
    drive.error.u = drive.byYaw(5.0);
    drive.error.v(4) = drive.error.u(3);
    for (int frame = 0; frame < 4; ++frame) {
      drive.addVerticalDisparities();
      drive.addMotion(0.35);
    }
    squares += std::pow(drive.calibration.correction().u(5), 2);
  }
  EXPECT_LT(std::sqrt(squares / kSeeds), 0.035);
}

/// Where lenses hide how far the camera was rolled, or how much longer its focal length is, the
/// motions show the rest.
TEST(OnlineStereoCalibration, WhatTheRowsShowIsAsUncertainAsTheyShowIt) {
  struct Case {
    int term_of_v, term_of_u;
    double u;
  };
  for (const Case& knocked : {Case{1, 2, -1.3}, Case{2, 1, 1.3}}) {
    for (const unsigned seed : {1U, 2U, 3U}) {
      DistortedDrive drive(seed);
      drive.error.v << 0.0, 0.0, 0.4, 0.4, 0.4, 0.4, 0.0;
      drive.error.v(knocked.term_of_v) = 1.0;
      drive.error.u(knocked.term_of_u) = knocked.u;
      for (int frame = 0; frame < 10; ++frame) {
        drive.addVerticalDisparities();
        drive.addMotion(0.25);
      }
      EXPECT_NEAR(drive.calibration.correction().u(knocked.term_of_u), knocked.u, 0.15)
          << knocked.term_of_u << ", " << seed;
    }
  }
}

TEST(OnlineStereoCalibration, FramesAreWeightedByTheCubeOfTheShareOfNewFeatures) {
  CalibrationEvidence motion;
  motion.information(1, 1) = 1e4;
  motion.vector(1) = 1e12;  // noise does not explain it
  const auto estimated = [&](double share_of_new) {
    OnlineStereoCalibration calibration(synthetic::camera());
    calibration.addMotion(motion, share_of_new);
    return calibration.correction().u;
  };
  EXPECT_EQ(estimated(0.0), StereoCorrection::Coefficients::Zero());
  // With much less information than the prior the estimate is linear in it.
  const StereoCorrection::Coefficients little = estimated(0.0001);
  EXPECT_GT(little.norm(), 0.0);
  EXPECT_TRUE(estimated(0.0003).isApprox(27.0 * little, 1e-2));
  EXPECT_LT(estimated(0.1).norm(), 0.5 * estimated(1.0).norm());
}

/// In most of twenty drives, which differ in their noise; of one that is displaced most is found.
TEST(OnlineStereoCalibration, AnExactCameraStaysAsItIs) {
  constexpr int kDrives = 20;
  constexpr double kErrorPx = 0.1;
  int left_alone = 0;
  double squares = 0.0;
  double squares_of_error = 0.0;
  for (unsigned seed = 0; seed < kDrives; ++seed) {
    DistortedDrive exact(seed);
    DistortedDrive displaced(seed);
    displaced.error.u(0) = kErrorPx;
    for (int frame = 0; frame < 30; ++frame) {
      exact.addMotion(0.5);
      displaced.addMotion(0.5);
    }
    const StereoCorrection::Coefficients u = exact.calibration.correction().u;
    left_alone += u.isZero() ? 1 : 0;
    squares += u(0) * u(0);
    squares_of_error += std::pow(displaced.calibration.correction().u(0) - kErrorPx, 2);
  }
  EXPECT_GE(left_alone, 15);
  EXPECT_LT(std::sqrt(squares / kDrives), 0.003);
  EXPECT_LT(std::sqrt(squares_of_error / kDrives), 0.5 * kErrorPx);
}

/// The offset after motions that each show it so many times their own standard deviation, and what
/// it would be if noise explained nothing of it: the ratio.
double shareUsed(const std::vector<double>& deviations) {
  constexpr double kInformation = 1e4;
  constexpr double kPriorPx = 0.08;
  OnlineStereoCalibration calibration(synthetic::camera());
  double vector = 0.0;
  for (const double deviation : deviations) {
    CalibrationEvidence motion;
    motion.information(0, 0) = kInformation;
    motion.vector(0) = deviation * std::sqrt(kInformation);
    vector += motion.vector(0);
    calibration.addMotion(motion, 1.0);
  }
  const double information =
      static_cast<double>(deviations.size()) * kInformation + 1.0 / (kPriorPx * kPriorPx);
  return calibration.correction().u(0) / (vector / information);
}

TEST(OnlineStereoCalibration, WhatNoiseExplainsIsLeftOut) {
  EXPECT_NEAR(shareUsed({0.9}), 0.0, 1e-9) << "by the noise that the motion claims";
  EXPECT_NEAR(shareUsed({3.0}), 1.0 - 1.0 / 81.0, 1e-3) << "the same";
  // Motions that agree show their noise to be less than they claim.
  EXPECT_NEAR(shareUsed(std::vector<double>(10, 0.5)), 1.0, 1e-3);
  EXPECT_NEAR(shareUsed(std::vector<double>(10, 0.05)), 1.0, 1e-3);
  // The first deviates by 1.2 from none before it, the second by 0.2 from it.
  EXPECT_NEAR(shareUsed({1.2, 1.4}), 1.0 - std::pow((1.44 + 0.04) / 6.76, 2), 0.01);
  EXPECT_EQ(shareUsed({0.5, -0.4, 0.5, -0.4, 0.5, -0.4}), 0.0);
  EXPECT_EQ(shareUsed({3.0, -2.9, 3.0, -2.9}), 0.0);
}

/// As the first frame of a map: it counts as much as the next one.
TEST(OnlineStereoCalibration, AnUnknownShareOfNewFeaturesIsAssumedUntilThatOfTheNextMotion) {
  DistortedDrive drive(9);
  drive.error.u << 0.0, 0.25, 0.0, -0.3, 0.0, 0.0, 0.0;
  CalibrationEvidence motion = drive.motion();
  motion.vector *= 100.0;  // noise does not explain it
  const auto estimated = [&](const std::vector<std::optional<double>>& shares) {
    OnlineStereoCalibration calibration(drive.camera);
    for (const auto& share : shares) calibration.addMotion(motion, share);
    return calibration.correction().u;
  };
  constexpr double kAssumed = 0.35;
  constexpr double kKnown = 0.2;
  EXPECT_TRUE(estimated({std::nullopt}).isApprox(estimated({kAssumed})));
  EXPECT_TRUE(estimated({std::nullopt, kKnown}).isApprox(estimated({kKnown, kKnown})));
  EXPECT_TRUE(estimated({std::nullopt, std::nullopt, kKnown})
                  .isApprox(estimated({kAssumed, kKnown, kKnown})));
  EXPECT_FALSE(estimated({std::nullopt}).isApprox(estimated({kKnown}), 0.1)) << "it matters";
}

/// Also where there is a yaw, and rows between the motions.
TEST(OnlineStereoCalibration, AMotionThatWaitsCountsAsIfItsShareWereKnown) {
  DistortedDrive drive(11);
  drive.error.u = drive.byYaw(5.0);
  constexpr double kShare = 0.5;
  std::vector<CalibrationEvidence> motions;
  for (int frame = 0; frame < 8; ++frame) motions.push_back(drive.motion());
  OnlineStereoCalibration waited(drive.camera);
  OnlineStereoCalibration known(drive.camera);
  for (std::size_t k = 0; k < motions.size(); ++k) {
    waited.addMotion(motions[k], k == 0 ? std::nullopt : std::make_optional(kShare));
    known.addMotion(motions[k], kShare);
    const StereoCorrection::Coefficients u = waited.correction().u;
    waited.addVerticalDisparities({}, kSigmaPx);
    known.addVerticalDisparities({}, kSigmaPx);
    EXPECT_TRUE(waited.correction().u.isApprox(u)) << k;
    if (k > 0) {
      EXPECT_TRUE(waited.correction().u.isApprox(known.correction().u)) << k;
    }
  }
  EXPECT_GT(known.correction().u(0), 3.0) << "a yaw";
}

/// A prior of 0.08 px holds the offset of a calibrated camera.
TEST(OnlineStereoCalibration, AYawIsCorrectedByAFewMotions) {
  for (const double yaw_px : {0.7, -2.0, 5.0}) {
    DistortedDrive drive(11);
    drive.error.u = drive.byYaw(yaw_px);
    for (int frame = 0; frame < 8; ++frame) drive.addMotion();
    const StereoCorrection& correction = drive.calibration.correction();
    EXPECT_LT((correction.u - drive.error.u).cwiseAbs().maxCoeff(), 0.15) << yaw_px;
  }
}

/// It is larger while a yaw is known from little.
TEST(OnlineStereoCalibration, TheErrorOfDisparitiesIsThatOfTheYaw) {
  constexpr double kYawPx = 2.0;
  constexpr double kLittle = 0.2;
  for (unsigned seed = 0; seed < 20; ++seed) {
    DistortedDrive drive(seed);
    EXPECT_EQ(drive.calibration.correction().disparity_error_px, StereoCorrection::kCalibratedPx);
    drive.addMotion(kLittle);
    EXPECT_EQ(drive.calibration.correction().disparity_error_px, StereoCorrection::kCalibratedPx);
    drive.calibration = OnlineStereoCalibration(drive.camera);
    drive.error.u = drive.byYaw(kYawPx);
    for (int frame = 0; frame < 6; ++frame) drive.addMotion(kLittle);
    const StereoCorrection at_first = drive.calibration.correction();
    EXPECT_GT(at_first.disparity_error_px, 2.0 * StereoCorrection::kCalibratedPx) << seed;
    EXPECT_LT(std::abs(at_first.u(0) - drive.error.u(0)), 4.0 * at_first.disparity_error_px)
        << seed;
    for (int frame = 0; frame < 10; ++frame) drive.addMotion(1.0);
    EXPECT_LT(drive.calibration.correction().disparity_error_px, at_first.disparity_error_px);
  }
}

/// Motions with few new features say little of the offset.
TEST(OnlineStereoCalibration, NoiseOfMotionsIsNoYaw) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    DistortedDrive drive(seed);
    for (int frame = 0; frame < 20; ++frame) {
      drive.addMotion(frame < 10 ? 0.1 : 0.3);
      EXPECT_LT(drive.calibration.correction().u.cwiseAbs().maxCoeff(), 0.06) << seed;
    }
  }
}

TEST(OnlineStereoCalibration, ConvergesFromBothSides) {
  for (const double sign : {-1.0, 1.0}) {
    DistortedDrive drive(5);
    drive.error.u(1) = 0.2 * sign;
    double before = 0.2;
    for (int block = 0; block < 3; ++block) {
      for (int frame = 0; frame < 20; ++frame) drive.addMotion();
      const double left = std::abs(drive.calibration.correction().u(1) - drive.error.u(1));
      EXPECT_LT(left, before + 0.02);
      before = left;
    }
    EXPECT_LT(before, 0.06);
  }
}

TEST(OnlineStereoCalibration, CorrectCalibrationStaysNearZero) {
  DistortedDrive drive(6);
  for (int frame = 0; frame < 60; ++frame) {
    drive.addVerticalDisparities();
    drive.addMotion();
  }
  EXPECT_LT(drive.calibration.correction().u.cwiseAbs().maxCoeff(), 0.06);
  EXPECT_LT(drive.calibration.correction().v.cwiseAbs().maxCoeff(), 0.03);
  const Vector2d corner(5.0, 5.0);
  EXPECT_LT((drive.calibration.correction().apply(corner) - corner).norm(), 0.12);
}

/// With landmarks where they were triangulated, u(0) is 0.17 to 0.25 px with these seeds; see
/// withRefinedLandmark().
TEST(OnlineStereoCalibration, NoisyDisparitiesDoNotBiasIt) {
  double mean = 0.0;
  for (const unsigned seed : {1U, 2U, 3U, 4U}) {
    DistortedDrive drive(seed, kNoisySigmaPx);
    for (int frame = 0; frame < 200; ++frame) drive.addMotion();
    mean += drive.calibration.correction().u(0) / 4.0;
  }
  EXPECT_NEAR(mean, 0.0, 0.06);
}

TEST(OnlineStereoCalibration, AdaptsToAChange) {
  DistortedDrive drive(7);
  drive.error.v(0) = 0.3;
  for (int frame = 0; frame < 300; ++frame) drive.addVerticalDisparities();
  drive.error.v(0) = -0.3;
  for (int frame = 0; frame < 3000; ++frame) drive.addVerticalDisparities();
  EXPECT_NEAR(drive.calibration.correction().v(0), -0.3, 0.1);
}

TEST(OnlineStereoCalibration, WithoutDataTheEstimateIsUnchanged) {
  const StereoCamera camera = synthetic::camera();
  OnlineStereoCalibration calibration(camera);
  calibration.addVerticalDisparities({}, kSigmaPx);
  const auto nothing = calibrationEvidence({}, {}, {}, camera, calibration.correction());
  ASSERT_TRUE(nothing);
  calibration.addMotion(*nothing, 1.0);
  EXPECT_EQ(calibration.correction().u, StereoCorrection::Coefficients::Zero());
  EXPECT_EQ(calibration.correction().v, StereoCorrection::Coefficients::Zero());
  EXPECT_EQ(calibration.correction().disparity_error_px, StereoCorrection::kCalibratedPx);
}

TEST(CalibrationEvidence, IsOfTheInliers) {
  const StereoCamera camera = synthetic::camera();
  Correspondences matches = synthetic::matches(camera, synthetic::motion(), {60, 0}, 8);
  MotionEstimate motion = estimateMotion(matches, camera, synthetic::motion(), {});
  ASSERT_TRUE(motion.ok());
  for (int i = 0; i < 20; ++i) {
    matches.points[i].right_px.x() += 50.0;
    motion.point_inliers[i] = false;
  }
  OnlineStereoCalibration calibration(camera);
  const auto evidence = calibrationEvidence(matches, motion, {}, camera, calibration.correction());
  ASSERT_TRUE(evidence);
  EXPECT_GT(evidence->information.trace(), 0.0);
  calibration.addMotion(*evidence, 1.0);
  EXPECT_LT(calibration.correction().u.cwiseAbs().maxCoeff(), 1e-6);
}

TEST(CalibrationEvidence, InvalidDataShowNothing) {
  const StereoCamera camera = synthetic::camera();
  Correspondences matches = synthetic::matches(camera, synthetic::motion(), {60, 0}, 9);
  const MotionEstimate motion = estimateMotion(matches, camera, synthetic::motion(), {});
  matches.points[0].left_px.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(calibrationEvidence(matches, motion, {}, camera, StereoCorrection(camera)));
}

}  // namespace
}  // namespace point_line_odometry
