#include "motion/motion_consensus.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <utility>

#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// 40 degrees about an oblique axis and 5 m: all pixels change.
Isometry3d farMotion() {
  return synthetic::transform(40.0 * M_PI / 180.0 * Vector3d(0.36, 0.8, 0.48), {-3.0, 0.0, 4.0});
}

/// A match of a motion: its point is in view in both frames, pixels are whole numbers.
PointCorrespondence rightMatch(const StereoCamera& camera, const Isometry3d& T_curr_prev,
                               synthetic::Random* random) {
  const Vector3d p_curr = synthetic::visiblePoint(camera, random);
  PointCorrespondence match;
  match.p_prev = T_curr_prev.inverse() * p_curr;
  match.left_px = camera.projectLeft(p_curr).array().round();
  match.right_px = camera.projectRight(p_curr).array().round();
  return match;
}

/// Random pixels of the current frame, independent of the point.
PointCorrespondence wrongMatch(const StereoCamera& camera, const Isometry3d& T_curr_prev,
                               synthetic::Random* random) {
  PointCorrespondence match = rightMatch(camera, T_curr_prev, random);
  const Vector3d elsewhere = synthetic::visiblePoint(camera, random);
  match.left_px = camera.projectLeft(elsewhere);
  match.right_px = camera.projectRight(elsewhere);
  return match;
}

/// The first match of every group is correct: `right` of `all`, evenly distributed.
std::vector<PointCorrespondence> mixedMatches(const Isometry3d& T_curr_prev, int right, int all,
                                              unsigned seed) {
  synthetic::Random random(seed);
  const StereoCamera camera = synthetic::camera();
  std::vector<PointCorrespondence> matches;
  for (int i = 0; i < all; ++i) {
    const bool is_right = (i + 1) * right / all > i * right / all;
    matches.push_back(is_right ? rightMatch(camera, T_curr_prev, &random)
                               : wrongMatch(camera, T_curr_prev, &random));
  }
  return matches;
}

bool isRight(const PointCorrespondence& match, const Isometry3d& ground_truth) {
  const Vector3d p = ground_truth * match.p_prev;
  return p.z() > 0.0 && (synthetic::camera().projectLeft(p) - match.left_px).norm() < 1.0;
}

/// Largest reprojection error of the correct matches at a motion.
double worstError(const std::vector<PointCorrespondence>& matches, const Isometry3d& ground_truth,
                  const Isometry3d& found) {
  double worst = 0.0;
  for (const PointCorrespondence& match : matches) {
    if (!isRight(match, ground_truth)) continue;
    const Vector2d expected = synthetic::camera().projectLeft(found * match.p_prev);
    worst = std::max(worst, (expected - match.left_px).norm());
  }
  return worst;
}

struct Case {
  int right;
  int all;
  Isometry3d ground_truth;
};

class ConsensusTest : public ::testing::TestWithParam<Case> {};

TEST_P(ConsensusTest, IsFoundAmongWrongMatches) {
  const auto& [right, all, ground_truth] = GetParam();
  for (const unsigned seed : {1U, 2U, 3U, 4U, 5U}) {
    const auto matches = mixedMatches(ground_truth, right, all, seed);
    const auto consensus = findConsensus(matches, synthetic::camera());
    ASSERT_TRUE(consensus) << seed;
    // The consensus is of three matches of whole pixels: it initializes the search near it.
    EXPECT_LT(worstError(matches, ground_truth, consensus->T_curr_prev), 12.0) << seed;
    ASSERT_EQ(consensus->inliers.size(), matches.size());
    int num_inliers = 0;
    int wrong_inliers = 0;
    for (std::size_t i = 0; i < matches.size(); ++i) {
      num_inliers += consensus->inliers[i] ? 1 : 0;
      wrong_inliers += consensus->inliers[i] && !isRight(matches[i], ground_truth) ? 1 : 0;
    }
    EXPECT_EQ(consensus->num_inliers, num_inliers);
    EXPECT_GE(num_inliers, 0.8 * right) << seed;
    EXPECT_LE(wrong_inliers, 1) << seed;
  }
}

INSTANTIATE_TEST_SUITE_P(Shares, ConsensusTest,
                         ::testing::Values(Case{200, 200, farMotion()}, Case{80, 200, farMotion()},
                                           Case{40, 200, farMotion()},
                                           Case{80, 200, synthetic::motion()},
                                           Case{40, 200, Isometry3d::Identity()}));

/// Most matches agree on one motion, as those of structure that repeats itself: it is a repetition
/// off.
TEST(OutliersOf, HaveAnotherMotion) {
  const StereoCamera camera = synthetic::camera();
  Isometry3d wrong = farMotion();
  wrong.translation().z() += 4.0;
  synthetic::Random random(7);
  std::vector<PointCorrespondence> matches;
  for (int i = 0; i < 90; ++i)
    matches.push_back(rightMatch(camera, i % 3 == 0 ? farMotion() : wrong, &random));
  const auto first = findConsensus(matches, camera);
  ASSERT_TRUE(first);
  EXPECT_LT((first->T_curr_prev.translation() - wrong.translation()).norm(), 0.5);
  const std::vector<PointCorrespondence> rest = outliersOf(matches, camera, wrong);
  EXPECT_GE(rest.size(), 25U);
  EXPECT_LE(rest.size(), 30U);
  const auto second = findConsensus(rest, camera);
  ASSERT_TRUE(second);
  EXPECT_LT((second->T_curr_prev.translation() - farMotion().translation()).norm(), 0.5);
}

/// Of an inlier errors are up to 3 px; what is farther off than twice that is not explained.
TEST(OutliersOf, AreFartherOffThanTwoErrorsOfAnInlier) {
  const StereoCamera camera = synthetic::camera();
  synthetic::Random random(8);
  for (const double error_px : {0.0, 5.0, 7.0}) {
    PointCorrespondence match = rightMatch(camera, farMotion(), &random);
    match.left_px = camera.projectLeft(farMotion() * match.p_prev) + Vector2d(0.0, error_px);
    EXPECT_EQ(outliersOf({match}, camera, farMotion()).size(), error_px > 6.0 ? 1U : 0U)
        << error_px;
  }
  PointCorrespondence unknown = rightMatch(camera, farMotion(), &random);
  unknown.left_px.x() = kNaN;
  EXPECT_EQ(outliersOf({unknown}, camera, farMotion()).size(), 1U);
  EXPECT_TRUE(outliersOf({}, camera, farMotion()).empty());
}

TEST(FindConsensus, IsAsAccurateAsPixelsAllow) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    auto matches = mixedMatches(farMotion(), 60, 200, seed);
    for (PointCorrespondence& match : matches) {
      if (!isRight(match, farMotion())) continue;
      match.left_px = synthetic::camera().projectLeft(farMotion() * match.p_prev);
      match.right_px = synthetic::camera().projectRight(farMotion() * match.p_prev);
    }
    const auto consensus = findConsensus(matches, synthetic::camera());
    ASSERT_TRUE(consensus) << seed;
    EXPECT_LT(worstError(matches, farMotion(), consensus->T_curr_prev), 0.01) << seed;
    EXPECT_LT((consensus->T_curr_prev.translation() - farMotion().translation()).norm(), 1e-4);
    EXPECT_GE(consensus->num_inliers, 60);
  }
}

TEST(FindConsensus, UsesTheRightImage) {
  // In the left image all are inliers; in the right one half of them are outliers.
  auto matches = mixedMatches(farMotion(), 100, 100, 1);
  for (std::size_t i = 0; i < matches.size(); i += 2) matches[i].right_px.x() -= 10.0;
  const auto consensus = findConsensus(matches, synthetic::camera());
  ASSERT_TRUE(consensus);
  for (std::size_t i = 0; i < matches.size(); i += 2) EXPECT_FALSE(consensus->inliers[i]);
}

TEST(FindConsensus, SameMatchesGiveTheSameBits) {
  const auto matches = mixedMatches(farMotion(), 60, 200, 7);
  const auto a = findConsensus(matches, synthetic::camera());
  const auto b = findConsensus(matches, synthetic::camera());
  ASSERT_TRUE(a && b);
  EXPECT_EQ(a->T_curr_prev.matrix(), b->T_curr_prev.matrix());
  EXPECT_EQ(a->inliers, b->inliers);
}

TEST(FindConsensus, TooFewMatchesGiveNone) {
  EXPECT_FALSE(findConsensus({}, synthetic::camera()));
  for (const int count : {1, 2, 3, kMinConsensus - 1})
    EXPECT_FALSE(findConsensus(mixedMatches(farMotion(), count, count, 1), synthetic::camera()));
  const int enough = kMinConsensus + 4;
  EXPECT_TRUE(findConsensus(mixedMatches(farMotion(), enough, enough, 1), synthetic::camera()));
}

TEST(FindConsensus, WrongMatchesAloneGiveNone) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    EXPECT_FALSE(findConsensus(mixedMatches(farMotion(), 0, 60, seed), synthetic::camera()))
        << seed;
  }
}

/// Matches of points some hundred metres away, of a camera that turns by 10 degrees, `right` of
/// `all`, evenly distributed.
std::vector<PointCorrespondence> farMatches(const Isometry3d& T_curr_prev, int right, int all,
                                            unsigned seed) {
  const StereoCamera camera = synthetic::camera();
  synthetic::Random random(seed);
  std::vector<PointCorrespondence> matches;
  for (int i = 0; i < all; ++i) {
    const bool is_right = (i + 1) * right / all > i * right / all;
    const Vector3d p_curr = random.uniform(50.0, 100.0) * synthetic::visiblePoint(camera, &random);
    const Vector3d elsewhere = 50.0 * synthetic::visiblePoint(camera, &random);
    PointCorrespondence match;
    match.p_prev = T_curr_prev.inverse() * p_curr;
    match.left_px = camera.projectLeft(is_right ? p_curr : elsewhere).array().round();
    match.right_px = camera.projectRight(is_right ? p_curr : elsewhere).array().round();
    match.far = true;
    matches.push_back(match);
  }
  return matches;
}

TEST(FindRotation, IsFoundAmongWrongMatches) {
  const Isometry3d ground_truth =
      synthetic::transform(10.0 * M_PI / 180.0 * Vector3d(0.8, 0.6, 0.0), {0.2, 0.0, -4.8});
  const Vector3d position = ground_truth.inverse().translation();
  const Vector3d known_roughly = position + Vector3d(0.1, -0.2, 0.5);
  for (const unsigned seed : {1U, 2U, 3U, 4U, 5U}) {
    for (const auto& [right, all] : {std::pair(100, 100), std::pair(20, 110)}) {
      const auto consensus = findRotation(farMatches(ground_truth, right, all, seed),
                                          synthetic::camera(), known_roughly);
      ASSERT_TRUE(consensus) << seed;
      const Isometry3d& found = consensus->T_curr_prev;
      const Eigen::Matrix3d error = found.linear() * ground_truth.linear().transpose();
      EXPECT_LT(Eigen::AngleAxisd(error).angle(), 0.02) << seed;
      EXPECT_LT((found.inverse().translation() - known_roughly).norm(), 1e-9) << seed;
      EXPECT_GE(consensus->num_inliers, 0.7 * right) << seed;
      EXPECT_LE(consensus->num_inliers, right + 1) << seed;
    }
  }
}

TEST(FindRotation, NeedsPointsInDifferentDirections) {
  const StereoCamera camera = synthetic::camera();
  EXPECT_FALSE(findRotation({}, camera, Vector3d::Zero()));
  EXPECT_FALSE(findRotation(farMatches(Isometry3d::Identity(), 0, 60, 1), camera, {0.0, 0.0, 0.0}));
  auto matches = farMatches(Isometry3d::Identity(), 40, 40, 1);
  for (PointCorrespondence& match : matches) match = matches.front();
  EXPECT_FALSE(findRotation(matches, camera, Vector3d::Zero()));
  for (PointCorrespondence& match : matches) match.p_prev.setConstant(kNaN);
  EXPECT_FALSE(findRotation(matches, camera, Vector3d::Zero()));
}

// --- Degenerate matches

void expectSane(const std::optional<MotionConsensus>& consensus) {
  EXPECT_TRUE(!consensus || consensus->T_curr_prev.matrix().allFinite());
}

TEST(FindConsensus, ToleratesDegenerateMatches) {
  const StereoCamera camera = synthetic::camera();
  const auto seen = [&](const Vector3d& p) {
    PointCorrespondence match;
    match.p_prev = farMotion().inverse() * p;
    match.left_px = camera.projectLeft(p);
    match.right_px = camera.projectRight(p);
    return match;
  };
  const std::vector<PointCorrespondence> same(40, seen({0.5, 0.2, 6.0}));
  expectSane(findConsensus(same, camera));
  std::vector<PointCorrespondence> on_a_line;
  for (int i = 0; i < 40; ++i) on_a_line.push_back(seen({0.02 * i, -0.01 * i, 5.0 + 0.05 * i}));
  expectSane(findConsensus(on_a_line, camera));
  std::vector<PointCorrespondence> at_the_camera = on_a_line;
  for (PointCorrespondence& match : at_the_camera) match.p_prev.setZero();
  expectSane(findConsensus(at_the_camera, camera));
}

TEST(FindConsensus, PointsBehindTheCameraAreNoInliers) {
  const StereoCamera camera = synthetic::camera();
  auto matches = mixedMatches(farMotion(), 100, 100, 2);
  // Far away, a point and its mirror image in the camera's centre have nearly the same images.
  for (std::size_t i = 0; i < 30; ++i) {
    const Vector3d p = farMotion() * matches[i].p_prev;
    const Vector3d far = 300.0 / p.z() * p;
    matches[i].p_prev = farMotion().inverse() * -far;
    matches[i].left_px = camera.projectLeft(far);
    matches[i].right_px = camera.projectRight(far);
  }
  const auto consensus = findConsensus(matches, camera);
  ASSERT_TRUE(consensus);
  for (std::size_t i = 0; i < 30; ++i) EXPECT_FALSE(consensus->inliers[i]);
  EXPECT_LT((consensus->T_curr_prev.translation() - farMotion().translation()).norm(), 0.3);
}

TEST(FindConsensus, NaNMatchesAreNoInliers) {
  auto matches = mixedMatches(farMotion(), 100, 100, 3);
  for (std::size_t i = 0; i < 40; i += 5) {
    matches[i].p_prev.x() = kNaN;
    matches[i + 1].left_px.x() = kNaN;
    matches[i + 2].left_px.y() = kNaN;
    matches[i + 3].right_px.x() = kNaN;
    matches[i + 4].p_prev *= 1e300;
  }
  const auto consensus = findConsensus(matches, synthetic::camera());
  ASSERT_TRUE(consensus);
  expectSane(consensus);
  for (std::size_t i = 0; i < 40; ++i) EXPECT_FALSE(consensus->inliers[i]) << i;
  EXPECT_GE(consensus->num_inliers, 48);

  for (PointCorrespondence& match : matches) match.left_px.setConstant(kNaN);
  EXPECT_FALSE(findConsensus(matches, synthetic::camera()));
}

}  // namespace
}  // namespace point_line_odometry
