#include "motion/landmark_refinement.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "geometry/triangulation.h"

namespace point_line_odometry {
namespace {

// Landmarks whose disparity is known better than this, relative to itself, stay where they are:
// their bias is below 0.2 %, and small errors of another kind, as those of patches in frames far
// apart, would get into the Jacobian.
constexpr double kMinRelativeNoise = 0.04;

// Of a residual with a larger square than this times its expectation, something else than noise may
// be wrong: it moves the landmark as one of that size does.
constexpr double kMaxSquare = 2.0;

}  // namespace

template <ResidualImages kImages>
PointCorrespondence withRefinedLandmark(const PointCorrespondence& match,
                                        const StereoCamera& camera,
                                        const Eigen::Isometry3d& T_curr_prev) {
  using Residual = PointResidual<kImages>;

  if (match.far || !(match.p_prev.z() > camera.baseline_m)) return match;
  const double disparity_px = camera.fx * camera.baseline_m / match.p_prev.z();
  const Eigen::Matrix3d by_point =
      backProjectionJacobian(camera, match.p_prev, disparity_px).inverse();
  const double disparity_variance =
      by_point.row(2) * match.covariance * by_point.row(2).transpose();
  if (!(disparity_variance > std::pow(kMinRelativeNoise * disparity_px, 2))) return match;
  const Residual residual(match, camera, T_curr_prev);
  if (!residual.valid) return match;
  const typename Residual::JacobianByLandmark J = residual.jacobianByLandmark();
  const auto weighted = (residualCovariance(residual, match).inverse() * residual.value).eval();

  const double square = residual.value.dot(weighted) / Residual::kRows;
  const double limit = std::sqrt(kMaxSquare / std::max(square, kMaxSquare));
  const Eigen::Vector3d step_px =
      -limit * (by_point * (match.covariance * (J.transpose() * weighted)));
  if (!(std::abs(step_px.z()) < 0.5 * disparity_px)) return match;

  PointCorrespondence refined = match;
  const double refined_px = disparity_px + step_px.z();
  refined.p_prev =
      backProject(camera, camera.projectLeft(match.p_prev) + step_px.head<2>(), refined_px);
  const Eigen::Matrix3d by_pixel = backProjectionJacobian(camera, refined.p_prev, refined_px);
  const Eigen::Matrix3d move = by_pixel * by_point;
  refined.covariance = move * match.covariance * move.transpose();
  const Residual at_refined(refined, camera, T_curr_prev);
  if (!at_refined.valid) return match;
  refined.offset_px.template head<Residual::kRows>() =
      -at_refined.jacobianByLandmark() * (by_pixel * step_px);
  return refined;
}

template PointCorrespondence withRefinedLandmark<ResidualImages::kLeft>(
    const PointCorrespondence& match, const StereoCamera& camera,
    const Eigen::Isometry3d& T_curr_prev);
template PointCorrespondence withRefinedLandmark<ResidualImages::kBoth>(
    const PointCorrespondence& match, const StereoCamera& camera,
    const Eigen::Isometry3d& T_curr_prev);

}  // namespace point_line_odometry
