#include "map/new_landmarks.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <opencv2/imgproc.hpp>

namespace point_line_odometry {
namespace {

constexpr int kHalfPatch = MapPoint::kPatchSide / 2;
constexpr float kApartPx = 8.0F;  // between a new point and others

}  // namespace

PointQuota::PointQuota(const StereoCamera& camera, int cell_size_px)
    : cell_size_(static_cast<float>(cell_size_px)),
      columns_(camera.width / cell_size_px + 1),
      cells_(static_cast<std::size_t>(columns_) * (camera.height / cell_size_px + 1)) {}

bool PointQuota::take(const Eigen::Vector2f& pixel, int wanted) {
  std::vector<Eigen::Vector2f>& points = cell(pixel);
  const auto near = [&](const Eigen::Vector2f& other) {
    return (other - pixel).squaredNorm() < kApartPx * kApartPx;
  };
  if (static_cast<int>(points.size()) >= wanted || std::any_of(points.begin(), points.end(), near))
    return false;
  points.push_back(pixel);
  return true;
}

std::vector<Eigen::Vector2f>& PointQuota::cell(const Eigen::Vector2f& pixel) {
  return cells_[static_cast<std::size_t>(static_cast<int>(pixel.y() / cell_size_) * columns_ +
                                         static_cast<int>(pixel.x() / cell_size_))];
}

bool patchFits(const Eigen::Vector2f& pixel, const StereoCamera& camera) {
  return pixel.x() >= kHalfPatch && pixel.y() >= kHalfPatch &&
         pixel.x() < static_cast<float>(camera.width - kHalfPatch) &&
         pixel.y() < static_cast<float>(camera.height - kHalfPatch);
}

MapPoint makePoint(const StereoFrame& frame, const StereoPoint& stereo,
                   const Eigen::Isometry3d& T_map_camera) {
  const PointFeature& feature = frame.features.points_left[stereo.left];
  const Eigen::Matrix3d& R = T_map_camera.linear();
  MapPoint point;
  point.place.value = T_map_camera * stereo.triangulated.p_camera;
  point.place.spread = R * Eigen::Matrix3d(stereo.triangulated.covariance.llt().matrixL());
  point.patch_axes = R * stereo.pixel_axes;
  cv::Mat patch(MapPoint::kPatchSide, MapPoint::kPatchSide, CV_8UC1, point.patch.data());
  point.octave = feature.octave;
  const Eigen::Vector2f pixel = frame.left_image.toLevel(feature.pixel, feature.octave);
  cv::getRectSubPix(frame.left_image.levels[static_cast<std::size_t>(feature.octave)], patch.size(),
                    {pixel.x(), pixel.y()}, patch);
  point.left = feature.descriptor;
  point.right = frame.features.points_right[stereo.right].descriptor;
  return point;
}

MapLine makeLine(const StereoFrame& frame, const StereoLine& stereo,
                 const Eigen::Isometry3d& T_map_camera) {
  const TriangulatedLine& triangulated = *stereo.triangulated;
  // Of the six eigenvalues two are zero: noise along the line is not in the covariance.
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(triangulated.covariance);
  const LineBelief::Spread spread =
      eigen.eigenvectors().rightCols<4>() *
      eigen.eigenvalues().tail<4>().cwiseMax(0.0).cwiseSqrt().asDiagonal();
  const Eigen::Matrix3d& R = T_map_camera.linear();
  MapLine line;
  line.place.value << T_map_camera * triangulated.start_camera,
      T_map_camera * triangulated.end_camera;
  line.place.spread << R * spread.topRows<3>(), R * spread.bottomRows<3>();
  line.left = frame.features.lines_left[stereo.left].descriptor;
  line.right = frame.features.lines_right[stereo.right].descriptor;
  return line;
}

}  // namespace point_line_odometry
