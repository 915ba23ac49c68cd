#include "odometry/compute_governor.h"

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

/// A frame's fixed part and what grows with the features [ms].
Computer computer(double fixed_ms, double features_ms) {
  return [=](double budget) { return fixed_ms + features_ms * budget; };
}

/// The budgets after each of the next frames.
std::vector<double> run(const Computer& frame_ms, int frames, ComputeGovernor* governor) {
  std::vector<double> budgets;
  for (int k = 0; k < frames; ++k)
    budgets.push_back(governor->addFrame(frame_ms(governor->budget())));
  return budgets;
}

int countChanges(const std::vector<double>& budgets) {
  int changes = 0;
  for (std::size_t i = 1; i < budgets.size(); ++i) changes += budgets[i] != budgets[i - 1] ? 1 : 0;
  return changes;
}

TEST(ComputeGovernor, LeavesAFastComputerAlone) {
  ComputeGovernor governor(50.0);
  for (const double budget : run(computer(10.0, 20.0), 100, &governor)) EXPECT_EQ(budget, 1.0);
}

TEST(ComputeGovernor, KeepsToTheTarget) {
  const Computer slow = computer(10.0, 60.0);
  ComputeGovernor governor(40.0);
  run(slow, 30, &governor);
  EXPECT_LE(slow(governor.budget()), 40.0);
  EXPECT_GE(slow(governor.budget()), 0.7 * 40.0) << "no more is given up than is needed";
}

TEST(ComputeGovernor, DoesNotSwingRoundTheTarget) {
  for (const double features_ms : {35.0, 60.0, 100.0, 300.0}) {
    const Computer slow = computer(10.0, features_ms);
    ComputeGovernor governor(40.0);
    run(slow, 200, &governor);
    EXPECT_EQ(countChanges(run(slow, 200, &governor)), 0) << features_ms;
  }
}

TEST(ComputeGovernor, NoiseOfTheTimesIsNotFollowed) {
  std::mt19937 random(1);
  const Computer noisy = [&random](double budget) {
    const double share = std::uniform_real_distribution<double>(0.9, 1.1)(random);
    const bool slow = std::uniform_int_distribution<int>(0, 19)(random) == 0;
    return (10.0 + 60.0 * budget) * share * (slow ? 2.0 : 1.0);
  };
  ComputeGovernor governor(40.0);
  run(noisy, 100, &governor);
  int over = 0;
  for (const double budget : run(noisy, 1000, &governor)) {
    EXPECT_GT(budget, 0.3);
    over += 10.0 + 60.0 * budget > 1.1 * 40.0 ? 1 : 0;
  }
  EXPECT_LT(over, 20) << "of 1000 frames";
}

TEST(ComputeGovernor, OneSlowFrameChangesNothing) {
  ComputeGovernor governor(40.0);
  for (int k = 0; k < 100; ++k)
    EXPECT_EQ(governor.addFrame(k % ComputeGovernor::kFramesPerDecision == 2 ? 500.0 : 30.0), 1.0);
}

TEST(ComputeGovernor, AnOverloadIsAnsweredWithinASecondOfFrames) {
  ComputeGovernor governor(40.0);
  run(computer(5.0, 30.0), 50, &governor);
  const Computer overloaded = computer(15.0, 90.0);
  run(overloaded, 20, &governor);
  EXPECT_LE(overloaded(governor.budget()), 40.0);
}

TEST(ComputeGovernor, GivesBackWhatAnOverloadTook) {
  ComputeGovernor governor(40.0);
  run(computer(10.0, 500.0), 50, &governor);
  EXPECT_EQ(governor.budget(), ComputeGovernor::kMinBudget);
  const std::vector<double> budgets = run(computer(5.0, 20.0), 200, &governor);
  EXPECT_EQ(budgets.back(), 1.0);
  for (std::size_t i = 1; i < budgets.size(); ++i)
    EXPECT_LE(budgets[i], 1.1001 * budgets[i - 1]) << "in small steps";
}

TEST(ComputeGovernor, NeverGoesBelowTheFloor) {
  ComputeGovernor governor(1.0);
  for (const double budget : run(computer(1000.0, 1000.0), 500, &governor)) {
    EXPECT_GE(budget, ComputeGovernor::kMinBudget);
    EXPECT_LE(budget, 1.0);
  }
  EXPECT_EQ(governor.budget(), ComputeGovernor::kMinBudget);
}

TEST(ComputeGovernor, ZeroIsOff) {
  ComputeGovernor governor(0.0);
  for (const double budget : run(computer(1e6, 1e6), 100, &governor)) EXPECT_EQ(budget, 1.0);
}

TEST(ComputeGovernor, TimesThatCannotBeAreIgnored) {
  ComputeGovernor governor(40.0);
  for (int k = 0; k < 100; ++k) {
    EXPECT_EQ(governor.addFrame(std::nan("")), 1.0);
    EXPECT_EQ(governor.addFrame(std::numeric_limits<double>::infinity()), 1.0);
    EXPECT_EQ(governor.addFrame(-100.0), 1.0);
  }
  EXPECT_THROW(ComputeGovernor(-1.0), std::invalid_argument);
  EXPECT_THROW(ComputeGovernor(std::nan("")), std::invalid_argument);
}

TEST(WithFeatureBudget, ScalesTheNumbersOfFeaturesAlone) {
  Parameters parameters;
  parameters.points.max_per_cell = 20;
  parameters.lines.max_count = 300;
  const ParameterTexts changed = changedParameters(parameters, withFeatureBudget(parameters, 0.25));
  const ParameterTexts expected{{"points/max_per_cell", "5"}, {"lines/max_count", "75"}};
  EXPECT_EQ(changed, expected);
  EXPECT_TRUE(changedParameters(parameters, withFeatureBudget(parameters, 1.0)).empty());
  EXPECT_TRUE(checkParameters(withFeatureBudget(parameters, 1e-6)).empty()) << "at least one";
}

}  // namespace
}  // namespace point_line_odometry
