#include "checks/resting_pattern.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

namespace point_line_odometry {
namespace {

constexpr int kColumns = 4;
constexpr int kRows = 3;

bool isUsable(const FollowedPoint& point) {
  constexpr double kLeastDisparity_px = 2.0;  // the horizon may rest while the ground moves
  return point.followed() && point.disparity >= kLeastDisparity_px;
}

/// The flows of the moving points near a point in the image and in depth.
std::vector<Eigen::Vector2d> flowsNearby(const FollowedFrame& frame, const FollowedPoint& point) {
  constexpr double kMoving_px = 3.0;
  const double depth = std::max(1.5, 0.2 * point.disparity);
  std::vector<Eigen::Vector2d> flows;
  for (const FollowedPoint& other : frame.points) {
    const bool moves = &other != &point && isUsable(other) && other.flow.norm() >= kMoving_px;
    if (moves && (point.pixel - other.pixel).norm() < frame.size.width / 8.0 &&
        std::abs(point.disparity - other.disparity) < depth) {
      flows.push_back(other.flow);
    }
  }
  return flows;
}

/// Whether any two of them are alike.
bool areTwoAlike(const std::vector<Eigen::Vector2d>& flows) {
  constexpr double kAlike_px = 1.5;
  for (auto a = flows.begin(); a != flows.end(); ++a) {
    const auto is_alike = [&](const Eigen::Vector2d& b) { return (*a - b).norm() < kAlike_px; };
    if (std::any_of(a + 1, flows.end(), is_alike)) return true;
  }
  return false;
}

}  // namespace

bool RestingPattern::isThere() const {
  // Without a projector at most one of thousands rests.
  constexpr int kFewestResting = 20;
  constexpr int kLeastPercent = 2;
  constexpr int kFewestCells = 5;  // not a bonnet, a robot's arm or dirt
  return resting >= kFewestResting && 100 * resting > kLeastPercent * compared &&
         cells >= kFewestCells;
}

RestingPattern findRestingPattern(const std::vector<const FollowedFrame*>& frames) {
  constexpr double kResting_px = 0.5;
  constexpr int kFewestInCell = 3;
  RestingPattern pattern;
  std::vector<int> cells(kColumns * kRows, 0);
  for (const FollowedFrame* frame : frames) {
    for (const FollowedPoint& point : frame->points) {
      if (!isUsable(point) || !areTwoAlike(flowsNearby(*frame, point))) continue;
      ++pattern.compared;
      if (point.flow.norm() >= kResting_px) continue;
      ++pattern.resting;
      ++cells[cellOf(point.pixel, frame->size, kColumns, kRows)];
    }
  }
  pattern.cells = static_cast<int>(
      std::count_if(cells.begin(), cells.end(), [](int n) { return n >= kFewestInCell; }));
  return pattern;
}

}  // namespace point_line_odometry
