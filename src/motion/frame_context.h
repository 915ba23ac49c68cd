#pragma once

#include <cstdint>

#include "features/feature_mask.h"
#include "features/image_pyramid.h"
#include "geometry/rolling_shutter.h"
#include "motion/frame_intervals.h"
#include "motion/noise_scale.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/stereo_correction.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// What turns features of the current frame into observations and motions; holds references.
struct FrameContext {
  const StereoImages& images;  ///< painted by the masks
  const StereoCamera& camera;
  StereoCorrection correction;  ///< of pixels in the right image
  const Parameters& parameters;
  NoiseScale noise = {};
  FrameIntervals intervals = {};  ///< of the frames before
  /// The images, with their coarser levels where points of those are in use.
  ImagePyramid left = ImagePyramid(images.left);
  ImagePyramid right = ImagePyramid(images.right);
  StereoMasks masks = {};       ///< with the same levels
  RollingShutter shutter = {};  ///< with the camera's velocity in this frame

  /// Time since an earlier frame, see FrameIntervals [s].
  double secondsSince(std::int64_t earlier_ns) const {
    return intervals.between(earlier_ns, images.stamp_ns);
  }
};

}  // namespace point_line_odometry
