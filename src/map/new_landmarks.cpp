#include "map/new_landmarks.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "matching/patch_warp.h"

namespace point_line_odometry {
namespace {

constexpr float kMinDistancePx = 8.0F;  // between a new point and others

}  // namespace

LandmarkCandidates landmarkCandidates(const StereoFrame& curr, const CircularMatches& matches,
                                      const MotionEstimate& motion) {
  LandmarkCandidates candidates;
  if (!motion.ok()) return candidates;
  std::vector<bool> matched(curr.points.size(), false);
  for (std::size_t i = 0; i < matches.points.size(); ++i) {
    const int point = matches.points[i].second;
    matched[point] = true;
    if (motion.point_inliers[i] && !curr.points[point].far) candidates.points.push_back(point);
  }
  for (std::size_t i = 0; i < matched.size(); ++i) {
    if (!matched[i] && !curr.points[i].far)
      candidates.unmatched_points.push_back(static_cast<int>(i));
  }
  for (std::size_t i = 0; i < matches.lines.size(); ++i) {
    if (motion.line_inliers[i]) candidates.lines.push_back(matches.lines[i].second);
  }
  return candidates;
}

PointBuckets::PointBuckets(const StereoCamera& camera, int cell_size_px)
    : cells_(camera.width, camera.height, cell_size_px) {}

bool PointBuckets::take(const Eigen::Vector2f& pixel, int wanted) {
  std::vector<Eigen::Vector2f>& points = cells_.at(pixel);
  const auto near = [&](const Eigen::Vector2f& other) {
    return (other - pixel).squaredNorm() < kMinDistancePx * kMinDistancePx;
  };
  if (static_cast<int>(points.size()) >= wanted || std::any_of(points.begin(), points.end(), near))
    return false;
  points.push_back(pixel);
  return true;
}

bool patchFits(const Eigen::Vector2f& pixel, const StereoCamera& camera) {
  return pixel.x() >= MapPoint::kHalfPatch && pixel.y() >= MapPoint::kHalfPatch &&
         pixel.x() < static_cast<float>(camera.width - MapPoint::kHalfPatch) &&
         pixel.y() < static_cast<float>(camera.height - MapPoint::kHalfPatch);
}

MapPoint makePoint(const StereoFrame& frame, const StereoPoint& stereo, const StereoCamera& camera,
                   const Eigen::Isometry3d& T_map_camera) {
  const Keypoint& keypoint = frame.features.points_left[stereo.left];
  const Eigen::Matrix3d& R = T_map_camera.linear();
  MapPoint point;
  point.estimate.value = T_map_camera * stereo.triangulated.p_camera;
  point.estimate.sqrt_covariance =
      R * Eigen::Matrix3d(stereo.triangulated.covariance.llt().matrixL());
  point.patch_axes = R * pixelAxes(camera, stereo);
  cv::Mat patch(MapPoint::kPatchSide, MapPoint::kPatchSide, CV_8UC1, point.patch.data());
  point.octave = keypoint.octave;
  const Eigen::Vector2f pixel = frame.left_image.toLevel(keypoint.pixel, keypoint.octave);
  cv::getRectSubPix(frame.left_image.levels[static_cast<std::size_t>(keypoint.octave)],
                    patch.size(), {pixel.x(), pixel.y()}, patch);
  point.left = keypoint.descriptor;
  point.right = frame.features.points_right[stereo.right].descriptor;
  return point;
}

MapLine makeLine(const StereoFrame& frame, const StereoLine& stereo,
                 const Eigen::Isometry3d& T_map_camera) {
  const TriangulatedLine& triangulated = *stereo.triangulated;
  // Of the six eigenvalues two are zero: noise along the line is not in the covariance.
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(triangulated.covariance);
  const LineEstimate::SqrtCovariance sqrt_covariance =
      eigen.eigenvectors().rightCols<4>() *
      eigen.eigenvalues().tail<4>().cwiseMax(0.0).cwiseSqrt().asDiagonal();
  const Eigen::Matrix3d& R = T_map_camera.linear();
  MapLine line;
  line.estimate.value << T_map_camera * triangulated.start_camera,
      T_map_camera * triangulated.end_camera;
  line.estimate.sqrt_covariance << R * sqrt_covariance.topRows<3>(),
      R * sqrt_covariance.bottomRows<3>();
  line.left = frame.features.lines_left[stereo.left].descriptor;
  line.right = frame.features.lines_right[stereo.right].descriptor;
  return line;
}

}  // namespace point_line_odometry
