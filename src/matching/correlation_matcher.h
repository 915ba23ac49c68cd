#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "common/thread_pool.h"
#include "features/feature_mask.h"
#include "features/features.h"
#include "features/image_pyramid.h"
#include "matching/expected_features.h"
#include "matching/stereo_frame.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// For each keypoint of the left image its pixel in the right one: its patch in the pyramid level
/// of the keypoint, searched along the epipolar line by ZNCC with a cross-check. Nothing where the
/// right image is masked.
std::vector<std::optional<Eigen::Vector2f>> matchStereoByCorrelation(
    const std::vector<Keypoint>& left, const ImagePyramid& left_image,
    const ImagePyramid& right_image, const StereoMasks& masks, const MatchingParameters& parameters,
    ThreadPool* threads);

/// A stereo point of the previous frame, found in the current one.
struct TrackedPoint {
  int previous = -1;  ///< index into the points of the previous frame
  Eigen::Vector2f left_px = Eigen::Vector2f::Zero();
  Eigen::Vector2f right_px = Eigen::Vector2f::Zero();
};

/// Where trackByCorrelation() searches.
struct CorrelationSearch {
  MotionPrediction prediction;
  /// [px of a level] limit of the prediction's radius: the time of a search grows with its square.
  float max_level_radius = 12.0F;
  float min_scale = 0.0F;  ///< of a level; points of finer ones are left out
};

/// Tracks the previous frame's points of coarser pyramid levels: their patches are searched by ZNCC
/// around their predicted pixels in the left image, then in that row of the right one, which must
/// confirm the predicted disparity. A track ends where an image is masked.
std::vector<TrackedPoint> trackByCorrelation(const StereoFrame& previous, const ImagePyramid& left,
                                             const ImagePyramid& right, const StereoMasks& masks,
                                             const StereoCamera& camera,
                                             const CorrelationSearch& search, ThreadPool* threads);

}  // namespace point_line_odometry
