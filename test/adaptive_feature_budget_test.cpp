#include "odometry/adaptive_feature_budget.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <stdexcept>
#include <vector>

namespace point_line_odometry {
namespace {

/// Time of a frame [ms] as a function of the budget.
using Computer = std::function<double(double budget)>;

/// A frame's fixed time and the part proportional to the features [ms].
Computer computer(double fixed_ms, double features_ms) {
  return [=](double budget) { return fixed_ms + features_ms * budget; };
}

/// The budgets after each of the next frames.
std::vector<double> run(const Computer& frame_ms, int frames, AdaptiveFeatureBudget* budget) {
  std::vector<double> budgets;
  for (int k = 0; k < frames; ++k)
    budgets.push_back(budget->addFrame(frame_ms(budget->budget().share)).share);
  return budgets;
}

int countChanges(const std::vector<double>& budgets) {
  int changes = 0;
  for (std::size_t i = 1; i < budgets.size(); ++i) changes += budgets[i] != budgets[i - 1] ? 1 : 0;
  return changes;
}

TEST(AdaptiveFeatureBudget, StaysAtOneOnAFastComputer) {
  AdaptiveFeatureBudget budget(50.0);
  for (const double budget : run(computer(10.0, 20.0), 100, &budget)) EXPECT_EQ(budget, 1.0);
}

TEST(AdaptiveFeatureBudget, ReachesTheTarget) {
  const Computer slow = computer(10.0, 60.0);
  AdaptiveFeatureBudget budget(40.0);
  run(slow, 30, &budget);
  EXPECT_LE(slow(budget.budget().share), 40.0);
  EXPECT_GE(slow(budget.budget().share), 0.9 * 40.0) << "no lower than necessary";
}

TEST(AdaptiveFeatureBudget, DoesNotOscillateAroundTheTarget) {
  for (const double features_ms : {35.0, 60.0, 100.0, 300.0}) {
    const Computer slow = computer(10.0, features_ms);
    AdaptiveFeatureBudget budget(40.0);
    run(slow, 200, &budget);
    EXPECT_EQ(countChanges(run(slow, 200, &budget)), 0) << features_ms;
  }
}

TEST(AdaptiveFeatureBudget, IgnoresNoiseOfTheTimes) {
  std::mt19937 random(1);
  const Computer noisy = [&random](double budget) {
    const double share = std::uniform_real_distribution<double>(0.9, 1.1)(random);
    const bool slow = std::uniform_int_distribution<int>(0, 19)(random) == 0;
    return (10.0 + 60.0 * budget) * share * (slow ? 2.0 : 1.0);
  };
  AdaptiveFeatureBudget budget(40.0);
  run(noisy, 100, &budget);
  int over = 0;
  for (const double budget : run(noisy, 1000, &budget)) {
    EXPECT_GT(budget, 0.3);
    over += 10.0 + 60.0 * budget > 1.1 * 40.0 ? 1 : 0;
  }
  EXPECT_LT(over, 20) << "of 1000 frames";
}

// --- Frames that are tracked by landmarks: above there are none, though they may be

/// A computer whose every second frame, where it may be one, is tracked by landmarks; the last
/// budget after some frames.
FeatureBudget runWithLandmarkFrames(double with_features_ms, int frames,
                                    AdaptiveFeatureBudget* budget) {
  bool by_landmarks = false;
  for (int k = 0; k < frames; ++k) {
    by_landmarks = !by_landmarks && budget->budget().landmark_frames;
    const double features_ms = 10.0 + (with_features_ms - 10.0) * budget->budget().share;
    budget->addFrame(by_landmarks ? 8.0 : features_ms, by_landmarks);
  }
  return budget->budget();
}

TEST(AdaptiveFeatureBudget, LandmarkFramesComeBeforeFarFewerFeatures) {
  AdaptiveFeatureBudget budget(40.0);
  EXPECT_EQ(runWithLandmarkFrames(60.0, 100, &budget), (FeatureBudget{1.0, true}));
  EXPECT_EQ(runWithLandmarkFrames(38.0, 100, &budget), (FeatureBudget{1.0, true}))
      << "all frames with features would take nearly the target";
  EXPECT_EQ(runWithLandmarkFrames(30.0, 100, &budget), FeatureBudget());
  const FeatureBudget used = runWithLandmarkFrames(44.0, 100, &budget);
  EXPECT_FALSE(used.landmark_frames) << "a few features less suffice";
  EXPECT_GT(used.share, 0.7);
}

/// Frames with features may take longer where all have them.
TEST(AdaptiveFeatureBudget, DoesNotOscillateBetweenFramesOfBothKindsAndOfOne) {
  for (const double with_features_ms : {34.0, 38.0, 42.0, 50.0, 60.0}) {
    AdaptiveFeatureBudget budget(40.0);
    bool by_landmarks = false;
    bool may_be = false;
    int changes = 0;
    for (int k = 0; k < 400; ++k) {
      by_landmarks = !by_landmarks && budget.budget().landmark_frames;
      const double slower = budget.budget().landmark_frames ? 1.0 : 1.15;
      const double features_ms = slower * with_features_ms * budget.budget().share;
      budget.addFrame(by_landmarks ? 8.0 : features_ms, by_landmarks);
      changes += budget.budget().landmark_frames != may_be ? 1 : 0;
      may_be = budget.budget().landmark_frames;
    }
    EXPECT_LE(changes, 1) << with_features_ms;
  }
}

TEST(AdaptiveFeatureBudget, OneSlowFrameOfEitherKindChangesNothing) {
  for (const int slow : {4, 5, 6, 7}) {
    AdaptiveFeatureBudget budget(40.0);
    for (int k = 0; k < 60; ++k) {
      const bool by_landmarks = k % 2 == 1;
      const double usual_ms = by_landmarks ? 8.0 : 70.0;
      const double frame_ms = k == 30 + slow ? 500.0 : usual_ms;
      EXPECT_EQ(budget.addFrame(frame_ms, by_landmarks), FeatureBudget());
    }
  }
}

/// Those that are so by the parameters are no gain.
TEST(AdaptiveFeatureBudget, FramesByLandmarksAreCountedOnce) {
  AdaptiveFeatureBudget budget(20.0);
  for (int k = 0; k < 6; ++k) budget.addFrame(k % 2 == 1 ? 8.0 : 70.0, k % 2 == 1);
  EXPECT_LT(budget.budget().share, 0.6);
}

TEST(AdaptiveFeatureBudget, FewerFeaturesHoldTheMeanWithLandmarkFrames) {
  AdaptiveFeatureBudget budget(20.0);
  const FeatureBudget used = runWithLandmarkFrames(70.0, 100, &budget);
  EXPECT_TRUE(used.landmark_frames);
  const double mean_ms = 0.5 * (10.0 + 60.0 * used.share + 8.0);
  EXPECT_LE(mean_ms, 20.0);
  EXPECT_GE(mean_ms, 0.9 * 20.0);
}

TEST(AdaptiveFeatureBudget, HoldsTheMeanOfTwoFramesOfThreeByLandmarks) {
  AdaptiveFeatureBudget budget(20.0);
  const auto detected_ms = [](double share) { return 10.0 + 60.0 * share; };
  for (int k = 0; k < 100; ++k) {
    const bool by_landmarks = k % 3 > 0;
    budget.addFrame(by_landmarks ? 8.0 : detected_ms(budget.budget().share), by_landmarks);
  }
  const double mean_ms = (detected_ms(budget.budget().share) + 2.0 * 8.0) / 3.0;
  EXPECT_LE(mean_ms, 20.0);
  EXPECT_GE(mean_ms, 0.8 * 20.0);
}

TEST(AdaptiveFeatureBudget, OneSlowFrameChangesNothing) {
  AdaptiveFeatureBudget budget(40.0);
  for (int k = 0; k < 100; ++k)
    EXPECT_EQ(budget.addFrame(k % AdaptiveFeatureBudget::kFramesPerDecision == 2 ? 500.0 : 30.0),
              FeatureBudget());
}

TEST(AdaptiveFeatureBudget, RespondsToAnOverloadWithinASecondOfFrames) {
  AdaptiveFeatureBudget budget(40.0);
  run(computer(5.0, 30.0), 50, &budget);
  const Computer overloaded = computer(15.0, 90.0);
  run(overloaded, 20, &budget);
  EXPECT_LE(overloaded(budget.budget().share), 40.0);
}

TEST(AdaptiveFeatureBudget, RecoversAfterAnOverload) {
  AdaptiveFeatureBudget budget(40.0);
  run(computer(10.0, 500.0), 50, &budget);
  EXPECT_EQ(budget.budget().share, AdaptiveFeatureBudget::kMinShare);
  const std::vector<double> budgets = run(computer(5.0, 20.0), 200, &budget);
  EXPECT_EQ(budget.budget(), FeatureBudget());
  for (std::size_t i = 1; i < budgets.size(); ++i)
    EXPECT_LE(budgets[i], 1.2501 * budgets[i - 1]) << "in small steps";
}

TEST(AdaptiveFeatureBudget, NeverFallsBelowTheMinimum) {
  AdaptiveFeatureBudget budget(1.0);
  for (const double budget : run(computer(1000.0, 1000.0), 500, &budget)) {
    EXPECT_GE(budget, AdaptiveFeatureBudget::kMinShare);
    EXPECT_LE(budget, 1.0);
  }
  EXPECT_EQ(budget.budget().share, AdaptiveFeatureBudget::kMinShare);
}

TEST(AdaptiveFeatureBudget, ZeroDisablesIt) {
  AdaptiveFeatureBudget budget(0.0);
  for (const double budget : run(computer(1e6, 1e6), 100, &budget)) EXPECT_EQ(budget, 1.0);
}

TEST(AdaptiveFeatureBudget, IgnoresInvalidTimes) {
  AdaptiveFeatureBudget budget(40.0);
  for (int k = 0; k < 100; ++k) {
    EXPECT_EQ(budget.addFrame(std::nan("")), FeatureBudget());
    EXPECT_EQ(budget.addFrame(std::numeric_limits<double>::infinity()), FeatureBudget());
    EXPECT_EQ(budget.addFrame(-100.0), FeatureBudget());
  }
  EXPECT_THROW(AdaptiveFeatureBudget(-1.0), std::invalid_argument);
  EXPECT_THROW(AdaptiveFeatureBudget(std::nan("")), std::invalid_argument);
}

TEST(WithFeatureBudget, ScalesTheNumbersOfFeaturesAndTheWeakestEdge) {
  Parameters parameters;
  parameters.points.max_per_cell = 20;
  parameters.lines.max_count = 300;
  parameters.lines.min_gradient = 5.0;
  parameters.lines.coarse_to_fine_points = 600;
  const ParameterTexts changed =
      changedParameters(parameters, withFeatureBudget(parameters, {0.25, false}));
  const ParameterTexts expected{{"points/max_per_cell", "5"},
                                {"lines/max_count", "75"},
                                {"lines/min_gradient", "20"},
                                {"lines/coarse_to_fine_points", "150"}};
  EXPECT_EQ(changed, expected);
  EXPECT_TRUE(changedParameters(parameters, withFeatureBudget(parameters, {})).empty());
  parameters.tracking.landmark_frames = 2;
  EXPECT_TRUE(changedParameters(parameters, withFeatureBudget(parameters, {1.0, true})).empty());
  parameters.tracking.landmark_frames = 0;
  EXPECT_EQ(withFeatureBudget(parameters, {1.0, true}).tracking.landmark_frames, 1);
  const Parameters least = withFeatureBudget(parameters, {1e-6, true});
  EXPECT_TRUE(checkParameters(least).empty()) << "at least one";
  EXPECT_EQ(least.lines.coarse_to_fine_points, 1);
  parameters.lines.coarse_to_fine_points = 100000;
  EXPECT_EQ(withFeatureBudget(parameters, {0.5, false}).lines.coarse_to_fine_points, 50000);
  parameters.lines.coarse_to_fine_points = 0;
  EXPECT_EQ(withFeatureBudget(parameters, {0.25, true}).lines.coarse_to_fine_points, 0);
  parameters.lines.min_gradient = 200.0;
  EXPECT_TRUE(checkParameters(withFeatureBudget(parameters, {0.2, true})).empty())
      << "at most the largest";
}

}  // namespace
}  // namespace point_line_odometry
