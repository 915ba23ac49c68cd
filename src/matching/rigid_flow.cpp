#include "matching/rigid_flow.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#include "common/statistics.h"
#include "geometry/se3.h"

namespace point_line_odometry {
namespace {

std::vector<Flow> flowsOf(const FollowedFrame& frame, const StereoCamera& camera) {
  std::vector<Flow> flows;
  for (const FollowedPoint& point : frame.points) {
    if (!point.followed()) continue;
    const Eigen::Vector2d& p = point.pixel;
    flows.push_back({{(p.x() - camera.cx) / camera.fx, (p.y() - camera.cy) / camera.fy, 1.0},
                     point.disparity / camera.fx,
                     p,
                     p + point.flow,
                     flows.size() % 2});
  }
  return flows;
}

/// One round of Gauss and Newton with the flows that `used` names.
/// \param deviations is set to the distances of all flows from the motion before [px].
void improve(const StereoCamera& camera, const std::vector<Flow>& flows,
             const std::vector<bool>& used, FrameMotion* motion, std::vector<double>* deviations) {
  constexpr double kNearest = 0.1;  // of a ray of length 1
  Matrix6d H = Matrix6d::Zero();
  Vector6d g = Vector6d::Zero();
  deviations->clear();
  for (std::size_t i = 0; i < flows.size(); ++i) {
    const Eigen::Vector3d p = motion->apply(flows[i]);
    if (p.z() < kNearest) {
      deviations->push_back(HUGE_VAL);
      continue;
    }
    const Eigen::Vector2d residual = flows[i].to_px - camera.projectLeft(p);
    deviations->push_back(residual.norm());
    if (!used[i]) continue;
    const Matrix26d J = motionJacobian(camera, flows[i], p);
    H += J.transpose() * J;
    g += J.transpose() * residual;
  }
  const Vector6d change = H.ldlt().solve(g);
  if (!change.allFinite()) return;
  const Eigen::Matrix3d R = expSO3(change.tail<3>());
  *motion = {R * motion->R, R * motion->t + change.head<3>()};
}

/// Fits the motion to the flows and drops those that do not agree with it; then to each half.
void fitMotion(const StereoCamera& camera, FlowStep* step) {
  constexpr int kRounds = 12;
  constexpr int kRoundsOfHalves = 3;
  constexpr double kLeastCut_px = 1.0;  // what a rolling shutter does is to be kept
  std::vector<bool> used(step->flows.size(), true);
  std::vector<double> deviations;
  for (int round = 0; round < kRounds; ++round) {
    improve(camera, step->flows, used, &step->motion, &deviations);
    const double most = std::max(kLeastCut_px, outlierCut(deviations));
    for (std::size_t i = 0; i < used.size(); ++i) used[i] = deviations[i] <= most;
  }
  std::vector<Flow> kept;
  for (std::size_t i = 0; i < used.size(); ++i) {
    if (used[i]) kept.push_back(step->flows[i]);
  }
  step->flows = std::move(kept);
  step->known = step->flows.size() >= FlowStep::kFewestPoints;
  for (std::size_t half = 0; step->known && half < step->of_halves.size(); ++half) {
    step->of_halves[half] = step->motion;
    std::vector<bool> in_half;
    for (const Flow& flow : step->flows) in_half.push_back(flow.half == half);
    for (int round = 0; round < kRoundsOfHalves; ++round) {
      improve(camera, step->flows, in_half, &step->of_halves[half], &deviations);
    }
  }
}

}  // namespace

Twist FrameMotion::twist(double period_s) const {
  const Eigen::Vector3d w = logSO3(R);
  return {leftJacobian(w).inverse() * t / period_s, w / period_s};
}

Eigen::Matrix<double, 2, 3> projectionJacobian(const StereoCamera& camera,
                                               const Eigen::Vector3d& p) {
  Eigen::Matrix<double, 2, 3> J;
  J << camera.fx / p.z(), 0.0, -camera.fx * p.x() / (p.z() * p.z()),  //
      0.0, camera.fy / p.z(), -camera.fy * p.y() / (p.z() * p.z());
  return J;
}

Matrix26d motionJacobian(const StereoCamera& camera, const Flow& flow, const Eigen::Vector3d& p) {
  Eigen::Matrix<double, 3, 6> by_motion;
  by_motion << flow.inverse_depth * Eigen::Matrix3d::Identity(), -skew(p);
  return projectionJacobian(camera, p) * by_motion;
}

double outlierCut(std::vector<double> deviations) {
  constexpr double kMadToSigma = 1.4826;
  constexpr double kSigmas = 3.0;
  return kSigmas * kMadToSigma * median(std::move(deviations));
}

FlowStep fitFlowStep(const FollowedFrame& frame, const StereoCamera& camera) {
  FlowStep step;
  step.period_s = frame.period_s;
  const bool usable = frame.period_s > 0.0 && frame.size.height == camera.height &&
                      frame.size.width == camera.width;
  if (usable) step.flows = flowsOf(frame, camera);
  if (step.flows.size() >= FlowStep::kFewestPoints) fitMotion(camera, &step);
  return step;
}

}  // namespace point_line_odometry
