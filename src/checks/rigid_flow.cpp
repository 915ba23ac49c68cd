#include "checks/rigid_flow.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "common/statistics.h"
#include "geometry/se3.h"

namespace point_line_odometry {
namespace {

/// Distances of the flows from the motion [px]; infinite behind the camera.
std::vector<double> deviationsFrom(const StereoCamera& camera, double read_out_s,
                                   const FlowStep& step) {
  constexpr double kNearest = 0.1;  // of a ray of length 1
  std::vector<double> deviations;
  deviations.reserve(step.flows.size());
  for (const Flow& flow : step.flows) {
    const Eigen::Vector3d xyz = step.predict(flow, read_out_s);
    deviations.push_back(xyz.z() < kNearest ? HUGE_VAL
                                            : (flow.to_px - camera.projectLeft(xyz)).norm());
  }
  return deviations;
}

/// One Gauss-Newton iteration with the inliers.
void improveMotion(const StereoCamera& camera, double read_out_s, FlowStep* step) {
  Matrix6d H = Matrix6d::Zero();
  Vector6d g = Vector6d::Zero();
  for (const Flow& flow : step->flows) {
    if (!flow.inlier) continue;
    const Eigen::Vector3d xyz = step->predict(flow, read_out_s);
    const Eigen::Matrix<double, 2, 6> J = motionJacobian(camera, flow, xyz);
    H += J.transpose() * J;
    g += J.transpose() * (flow.to_px - camera.projectLeft(xyz));
  }
  const Vector6d change = H.ldlt().solve(g);
  if (!change.allFinite()) return;
  const Eigen::Matrix3d R = expSO3(change.tail<3>());
  step->R = R * step->R;
  step->t = R * step->t + change.head<3>();
}

}  // namespace

Eigen::Vector3d FlowStep::predict(const Flow& flow, double read_out_s) const {
  const double w = flow.inverse_depth;
  const Eigen::Vector3d from =
      flow.ray - flow.from_row * read_out_s * first.at(flow.ray, w);  // at the middle row's time
  const Eigen::Vector3d to = R * from + w * t;
  return to + flow.to_row * read_out_s * second.at(to, w);
}

Eigen::Vector3d FlowStep::byReadOut(const Flow& flow) const {
  const double w = flow.inverse_depth;
  const Eigen::Vector3d to = R * flow.ray + w * t;
  return flow.to_row * second.at(to, w) - flow.from_row * (R * first.at(flow.ray, w));
}

Twist FlowStep::meanTwist() const {
  const Eigen::Vector3d w = logSO3(R);
  return {leftJacobian(w).inverse() * t / period_s, w / period_s};
}

Eigen::Matrix<double, 2, 3> projectionJacobian(const StereoCamera& camera,
                                               const Eigen::Vector3d& xyz) {
  Eigen::Matrix<double, 2, 3> J;
  J << camera.fx / xyz.z(), 0.0, -camera.fx * xyz.x() / (xyz.z() * xyz.z()),  //
      0.0, camera.fy / xyz.z(), -camera.fy * xyz.y() / (xyz.z() * xyz.z());
  return J;
}

Eigen::Matrix<double, 2, 6> motionJacobian(const StereoCamera& camera, const Flow& flow,
                                           const Eigen::Vector3d& xyz) {
  Eigen::Matrix<double, 3, 6> by_motion;
  by_motion << flow.inverse_depth * Eigen::Matrix3d::Identity(), -skew(xyz);
  return projectionJacobian(camera, xyz) * by_motion;
}

void fitMotion(const StereoCamera& camera, double read_out_s, FlowStep* step) {
  constexpr int kRounds = 12;
  constexpr double kMadToSigma = 1.4826;
  constexpr double kSigmas = 3.0;
  constexpr double kLeastCut_px = 0.5;
  for (int round = 0; round < kRounds; ++round) {
    std::vector<double> deviations = deviationsFrom(camera, read_out_s, *step);
    const double most = std::max(kLeastCut_px, kSigmas * kMadToSigma * median(deviations));
    int inliers = 0;
    for (std::size_t i = 0; i < step->flows.size(); ++i) {
      step->flows[i].inlier = deviations[i] <= most;
      if (step->flows[i].inlier) ++inliers;
    }
    step->known = inliers >= FlowStep::kFewestInliers && std::isfinite(most);
    if (!step->known) return;
    improveMotion(camera, read_out_s, step);
  }
}

}  // namespace point_line_odometry
