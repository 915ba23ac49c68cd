#pragma once

#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/stereo_odometry.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Large images are processed in a smaller size: sizes in pixels (cells, patches, search radii,
/// noise) then mean the same for every camera, and the number of features and the time have a
/// bound. Every pixel of the small image is the mean of a square of those of the large one.
class ImageReduction {
 public:
  ImageReduction(const StereoCamera& camera, const TrackingParameters& parameters);

  /// The camera that takes the small images.
  const StereoCamera& camera() const { return camera_; }

  /// The small images; those given if they are small enough.
  StereoImages reduce(const StereoImages& images) const;

  /// Turns pixels of the small images in a result into those of the large ones.
  void toInputPixels(FrameResult* result) const;

 private:
  int factor_;
  StereoCamera camera_;
};

}  // namespace point_line_odometry
