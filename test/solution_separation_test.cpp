#include "motion/solution_separation.h"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <vector>

#include "motion/patch_overlap.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Vector2d;

struct Match {
  Vector2d left_px;
  Matrix6d information;
  Vector6d gradient_of_error = Vector6d::Zero();  // J^T of the error
};

/// Matches all over the image that constrain all axes, and `num_strong` around a pixel that
/// constrain the first far more, but say that it is `error` / 20 larger.
std::vector<Match> matchesWith(int num_strong, const Vector2d& around_px, double error) {
  const StereoCamera camera = synthetic::camera();
  cv::RNG random(3);
  std::vector<Match> matches;
  for (int i = 0; i < 60; ++i) {
    Vector6d J;
    for (double& j : J) j = random.gaussian(1.0);
    const Vector2d pixel{random.uniform(0.0, 1.0) * camera.width,
                         random.uniform(0.0, 1.0) * camera.height};
    matches.push_back({pixel, J * J.transpose()});
  }
  for (int i = 0; i < num_strong; ++i) {
    const Vector6d J = 20.0 * Vector6d::Unit(0);
    matches.push_back({around_px + Vector2d(i, i), J * J.transpose(), error * J});
  }
  return matches;
}

/// The separation at the least-squares estimate: gradients add up to zero there.
std::optional<Eigen::AlignedBox2d> separatedPart(const std::vector<Match>& matches,
                                                 const Matrix6d& prior = Matrix6d::Zero()) {
  Matrix6d information = prior;
  Vector6d gradient = Vector6d::Zero();
  for (const Match& match : matches) {
    information += match.information;
    gradient += match.gradient_of_error;
  }
  const Vector6d step = -information.llt().solve(gradient);
  SolutionSeparation separation(synthetic::camera());
  separation.addPrior(prior);
  for (const Match& match : matches)
    separation.add(match.left_px, match.information,
                   match.gradient_of_error + match.information * step);
  return separation.mostSeparated();
}

TEST(SolutionSeparation, FindsThePartThatAllOthersDisagreeWith) {
  for (const Vector2d& around :
       {Vector2d(300.0, 200.0), Vector2d(0.0, 0.0), Vector2d(634.0, 474.0)}) {
    const auto part = separatedPart(matchesWith(4, around, 20.0));
    ASSERT_TRUE(part) << around.transpose();
    for (int i = 0; i < 4; ++i) EXPECT_TRUE(part->contains(around + Vector2d(i, i)));
    EXPECT_LE(part->sizes().x(), synthetic::camera().width / 8.0 + 1e-9);
  }
}

TEST(SolutionSeparation, NothingWhereAllAgree) {
  EXPECT_FALSE(separatedPart(matchesWith(4, {300.0, 200.0}, 0.0)));
  EXPECT_FALSE(separatedPart(matchesWith(4, {300.0, 200.0}, 4.0)));
}

TEST(SolutionSeparation, NothingOfMoreThanAThirdOfTheMatches) {
  EXPECT_FALSE(separatedPart(matchesWith(40, {300.0, 200.0}, 20.0)));
}

/// Where a prior knows the axis, the part has no leverage.
TEST(SolutionSeparation, NothingWhereAPriorDeterminesTheAxis) {
  EXPECT_FALSE(separatedPart(matchesWith(4, {300.0, 200.0}, 20.0), 1e6 * Matrix6d::Identity()));
}

TEST(SolutionSeparation, NothingWithoutMatches) {
  EXPECT_FALSE(SolutionSeparation(synthetic::camera()).mostSeparated());
}

TEST(PatchOverlap, IsTheCommonArea) {
  EXPECT_DOUBLE_EQ(overlap({{10.0, 10.0}, 8.0}, {{10.0, 10.0}, 8.0}), 1.0);
  EXPECT_DOUBLE_EQ(overlap({{10.0, 10.0}, 8.0}, {{14.0, 10.0}, 8.0}), 0.5);
  EXPECT_DOUBLE_EQ(overlap({{10.0, 10.0}, 8.0}, {{11.0, 9.0}, 4.0}), 0.5);  // within the other
  EXPECT_DOUBLE_EQ(overlap({{10.0, 10.0}, 8.0}, {{18.0, 10.0}, 8.0}), 0.0);
  EXPECT_DOUBLE_EQ(overlap({{10.0, 10.0}, 0.0}, {{10.0, 10.0}, 8.0}), 0.0);
  EXPECT_DOUBLE_EQ(overlap({{10.0, 10.0}, 0.0}, {{10.0, 10.0}, 0.0}), 0.0);
}

TEST(PatchOverlap, EachPairOnce) {
  cv::RNG random(5);
  std::vector<PatchArea> patches;
  for (int i = 0; i < 100; ++i)
    patches.push_back(
        {{random.uniform(0.0, 300.0), random.uniform(0.0, 200.0)}, random.uniform(0.0, 40.0)});
  cv::Mat1d found = cv::Mat1d::zeros(100, 100);
  int num_found = 0;
  forEachOverlap(patches, [&](std::size_t i, std::size_t j, double common) {
    ++num_found;
    found(static_cast<int>(i), static_cast<int>(j)) = common;
    found(static_cast<int>(j), static_cast<int>(i)) = common;
  });
  int num_expected = 0;
  for (int i = 0; i < 100; ++i) {
    for (int j = 0; j < i; ++j) {
      const double common =
          overlap(patches[static_cast<std::size_t>(i)], patches[static_cast<std::size_t>(j)]);
      num_expected += common > 0.0 ? 1 : 0;
      EXPECT_DOUBLE_EQ(found(i, j), common);
    }
  }
  EXPECT_GT(num_expected, 100);
  EXPECT_EQ(num_found, num_expected);
}

}  // namespace
}  // namespace point_line_odometry
