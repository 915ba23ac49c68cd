#include "point_line_odometry/calibration_refinement.h"

#include <gtest/gtest.h>

#include <limits>
#include <optional>
#include <vector>

#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kSigmaPx = 0.2;

/// Where a right camera with an error sees what a correct one sees at a pixel.
Vector2d distorted(const RightImageCorrection& error, const Vector2d& right_px) {
  const RightImageCorrection::Coefficients terms = error.terms(right_px);
  return right_px + Vector2d(error.u.dot(terms), error.v.dot(terms));
}

/// Frames of a camera whose right image has a known error, refined as the odometry does it.
class DistortedDrive {
 public:
  explicit DistortedDrive(unsigned seed) : random_(seed) {}

  /// The rows of one frame's stereo matches.
  void addRows() {
    std::vector<CalibrationRefinement::RowSample> samples;
    for (int i = 0; i < 200; ++i) {
      const Vector3d p = synthetic::visiblePoint(camera, &random_);
      const Vector2d seen = distorted(error, camera.projectRight(p)) + noise();
      samples.push_back({seen, seen.y() - (camera.projectLeft(p) + noise()).y()});
    }
    refinement.addRows(samples, kSigmaPx);
  }

  /// A frame's motion, estimated from what the camera sees with the correction so far.
  void addMotion(const std::optional<double>& share_of_new = 1.0) {
    const Isometry3d truth = synthetic::transform(
        {random_.uniform(-0.02, 0.02), random_.uniform(-0.05, 0.05), random_.uniform(-0.02, 0.02)},
        {random_.uniform(-0.1, 0.1), random_.uniform(-0.1, 0.1), random_.uniform(-1.2, -0.6)});
    const auto corrected = [&](const Vector3d& p) {
      return refinement.correction().apply(distorted(error, camera.projectRight(p)) + noise());
    };
    Correspondences matches;
    for (int i = 0; i < 200; ++i) {
      const Vector3d p = synthetic::visiblePoint(camera, &random_);
      const auto triangulated = triangulatePoint(camera, camera.projectLeft(p) + noise(),
                                                 corrected(p).x(), kSigmaPx, 0.1);
      if (!triangulated || (truth * p).z() < 1.0) continue;
      PointCorrespondence match;
      match.p_prev = triangulated->p_camera;
      match.covariance = triangulated->covariance;
      match.left_px = camera.projectLeft(truth * p) + noise();
      match.right_px = corrected(truth * p);
      match.sigma_px = kSigmaPx;
      matches.points.push_back(match);
    }
    const MotionEstimate motion = estimateMotion(matches, camera, truth, {});
    ASSERT_TRUE(motion.ok());
    refinement.addMotion(matches, motion, {}, share_of_new);
  }

  const StereoCamera camera = synthetic::camera();
  RightImageCorrection error{camera};
  CalibrationRefinement refinement{camera};

 private:
  Vector2d noise() { return {random_.normal(kSigmaPx), random_.normal(kSigmaPx)}; }

  synthetic::Random random_;
};

TEST(RightImageCorrection, TermsAreThoseOfTheHeader) {
  const StereoCamera camera = synthetic::camera();
  const RightImageCorrection correction(camera);
  // x is 1 half an image's width right of the principal point; y has the same unit.
  RightImageCorrection::Coefficients expected;
  expected << 1.0, 1.0, 0.5, 2.0 / 3.0, 0.5, 0.25;
  EXPECT_LT((correction.terms({camera.cx + 320.0, camera.cy + 160.0}) - expected).norm(), 1e-12);
  expected << 1.0, 0.0, 0.0, -1.0 / 3.0, 0.0, 0.0;
  EXPECT_LT((correction.terms({camera.cx, camera.cy}) - expected).norm(), 1e-12);
}

TEST(RightImageCorrection, DefaultMovesNothing) {
  EXPECT_EQ(RightImageCorrection().apply({123.0, 45.0}), Vector2d(123.0, 45.0));
  EXPECT_EQ(RightImageCorrection(synthetic::camera()).apply({123.0, 45.0}), Vector2d(123.0, 45.0));
}

TEST(RightImageCorrection, TakesTheDisplacementAway) {
  RightImageCorrection correction(synthetic::camera());
  correction.u(0) = 0.25;
  correction.v(1) = -0.5;
  const Vector2d moved = correction.apply({synthetic::camera().cx + 320.0, 100.0});
  EXPECT_NEAR(moved.x(), synthetic::camera().cx + 320.0 - 0.25, 1e-12);
  EXPECT_NEAR(moved.y(), 100.5, 1e-12);
}

TEST(CalibrationRefinement, RowsAreLearntWithinAFewFrames) {
  DistortedDrive drive(1);
  drive.error.v << 0.3, -0.25, 0.2, 0.15, -0.2, 0.1;
  for (int frame = 0; frame < 10; ++frame) drive.addRows();
  EXPECT_LT((drive.refinement.correction().v - drive.error.v).cwiseAbs().maxCoeff(), 0.12);
  EXPECT_EQ(drive.refinement.correction().u, RightImageCorrection::Coefficients::Zero());
  for (int frame = 0; frame < 90; ++frame) drive.addRows();
  EXPECT_LT((drive.refinement.correction().v - drive.error.v).cwiseAbs().maxCoeff(), 0.03);
}

TEST(CalibrationRefinement, WrongMatchesHardlyMoveTheRows) {
  DistortedDrive drive(2);
  synthetic::Random random(3);
  for (int frame = 0; frame < 30; ++frame) {
    drive.addRows();
    std::vector<CalibrationRefinement::RowSample> wrong;
    for (int i = 0; i < 20; ++i)
      wrong.push_back({{random.uniform(0.0, 640.0), random.uniform(0.0, 480.0)}, 2.0});
    drive.refinement.addRows(wrong, kSigmaPx);
  }
  EXPECT_LT(drive.refinement.correction().v.cwiseAbs().maxCoeff(), 0.2);
}

TEST(CalibrationRefinement, DisparityErrorsAreLearntFromTheMotion) {
  // The terms x and x^2 - 1/3, those of a turned or badly calibrated right camera.
  DistortedDrive drive(4);
  drive.error.u << 0.0, 0.25, 0.0, -0.3, 0.0, 0.0;
  for (int frame = 0; frame < 60; ++frame) drive.addMotion();
  const RightImageCorrection::Coefficients u = drive.refinement.correction().u;
  EXPECT_NEAR(u(1), 0.25, 0.08);
  EXPECT_NEAR(u(3), -0.3, 0.08);
  EXPECT_EQ(drive.refinement.correction().v, RightImageCorrection::Coefficients::Zero());
}

TEST(CalibrationRefinement, FramesCountByTheSquareOfWhatIsNewInThem) {
  const auto learnt = [](double share_of_new) {
    DistortedDrive drive(9);
    drive.error.u << 0.0, 0.25, 0.0, -0.3, 0.0, 0.0;
    drive.addMotion(share_of_new);
    return drive.refinement.correction().u;
  };
  EXPECT_EQ(learnt(0.0), RightImageCorrection::Coefficients::Zero());
  // Far less than the prior, information adds up linearly.
  const RightImageCorrection::Coefficients little = learnt(0.0001);
  EXPECT_GT(little.norm(), 0.0);
  EXPECT_TRUE(learnt(0.0003).isApprox(9.0 * little, 1e-2));
  EXPECT_LT(learnt(0.1).norm(), 0.5 * learnt(1.0).norm());
}

/// As the first frame of a map: it counts as much as the next one.
TEST(CalibrationRefinement, AFrameOfWhichNobodyKnowsWhatIsNewWaitsForTheNextOne) {
  constexpr double kShare = 0.0001;  // so little that the correction does not change what is seen
  const auto learnt = [](const std::vector<std::optional<double>>& shares) {
    DistortedDrive drive(9);
    drive.error.u << 0.0, 0.25, 0.0, -0.3, 0.0, 0.0;
    for (const auto& share : shares) drive.addMotion(share);
    return drive.refinement.correction().u;
  };
  EXPECT_EQ(learnt({std::nullopt}), RightImageCorrection::Coefficients::Zero());
  EXPECT_TRUE(learnt({std::nullopt, kShare}).isApprox(learnt({kShare, kShare}), 1e-3));
  EXPECT_FALSE(learnt({std::nullopt, kShare}).isApprox(learnt({kShare}), 0.1)) << "it counts";
  EXPECT_TRUE(
      learnt({std::nullopt, kShare, kShare}).isApprox(learnt({kShare, kShare, kShare}), 1e-3))
      << "once";
}

TEST(CalibrationRefinement, ConvergesFromBothSides) {
  for (const double sign : {-1.0, 1.0}) {
    DistortedDrive drive(5);
    drive.error.u(1) = 0.2 * sign;
    double before = 0.2;
    for (int block = 0; block < 3; ++block) {
      for (int frame = 0; frame < 20; ++frame) drive.addMotion();
      const double left = std::abs(drive.refinement.correction().u(1) - drive.error.u(1));
      EXPECT_LT(left, before + 0.02);
      before = left;
    }
    EXPECT_LT(before, 0.06);
  }
}

TEST(CalibrationRefinement, CorrectCalibrationStaysNearZero) {
  DistortedDrive drive(6);
  for (int frame = 0; frame < 60; ++frame) {
    drive.addRows();
    drive.addMotion();
  }
  EXPECT_LT(drive.refinement.correction().u.cwiseAbs().maxCoeff(), 0.06);
  EXPECT_LT(drive.refinement.correction().v.cwiseAbs().maxCoeff(), 0.03);
  const Vector2d corner(5.0, 5.0);
  EXPECT_LT((drive.refinement.correction().apply(corner) - corner).norm(), 0.12);
}

TEST(CalibrationRefinement, FollowsAChange) {
  DistortedDrive drive(7);
  drive.error.v(0) = 0.3;
  for (int frame = 0; frame < 300; ++frame) drive.addRows();
  drive.error.v(0) = -0.3;
  for (int frame = 0; frame < 3000; ++frame) drive.addRows();
  EXPECT_NEAR(drive.refinement.correction().v(0), -0.3, 0.1);
}

TEST(CalibrationRefinement, NothingIsLearntFromNothing) {
  CalibrationRefinement refinement(synthetic::camera());
  refinement.addRows({}, kSigmaPx);
  refinement.addMotion({}, {}, {}, 1.0);
  MotionEstimate motion;
  motion.status = MotionStatus::kOk;
  refinement.addMotion({}, motion, {}, 1.0);
  EXPECT_EQ(refinement.correction().u, RightImageCorrection::Coefficients::Zero());
  EXPECT_EQ(refinement.correction().v, RightImageCorrection::Coefficients::Zero());
}

TEST(CalibrationRefinement, OutliersOfTheMotionAreLeftOut) {
  const StereoCamera camera = synthetic::camera();
  Correspondences matches = synthetic::matches(camera, synthetic::motion(), {60, 0}, 8);
  MotionEstimate motion = estimateMotion(matches, camera, synthetic::motion(), {});
  ASSERT_TRUE(motion.ok());
  for (int i = 0; i < 20; ++i) {
    matches.points[i].right_px.x() += 50.0;
    motion.point_inliers[i] = false;
  }
  CalibrationRefinement refinement(camera);
  refinement.addMotion(matches, motion, {}, 1.0);
  EXPECT_LT(refinement.correction().u.cwiseAbs().maxCoeff(), 1e-6);
}

TEST(CalibrationRefinement, GarbageDoesNotSpoilIt) {
  const StereoCamera camera = synthetic::camera();
  Correspondences matches = synthetic::matches(camera, synthetic::motion(), {60, 0}, 9);
  const MotionEstimate motion = estimateMotion(matches, camera, synthetic::motion(), {});
  matches.points[0].left_px.x() = std::numeric_limits<double>::quiet_NaN();
  CalibrationRefinement refinement(camera);
  refinement.addMotion(matches, motion, {}, 1.0);
  EXPECT_TRUE(refinement.correction().u.allFinite());
}

}  // namespace
}  // namespace point_line_odometry
