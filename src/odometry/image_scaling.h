#pragma once

#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Large images are reduced and small ones enlarged before processing, by whole numbers: sizes in
/// pixels (cells, patches, search radii, noise) are then comparable for all cameras, and the number
/// of features and the time are bounded. A pixel of a reduced image is the mean of a square of
/// pixels of the input; enlarged images are interpolated by cubic splines, so that small ones are
/// used to a fraction of their pixels.
class ImageScaling {
 public:
  ImageScaling(const StereoCamera& camera, const TrackingParameters& parameters);

  /// The camera that takes the scaled images.
  const StereoCamera& camera() const { return camera_; }

  /// The scaled images and masks; those given where their size fits. A pixel that takes something
  /// from an ignored one is ignored.
  StereoImages scale(const StereoImages& images) const;

  /// Converts pixels in a result from the scaled images to the input.
  void toInputPixels(FrameResult* result) const;

 private:
  int reduction_ = 1;
  int enlargement_ = 1;
  StereoCamera camera_;
};

}  // namespace point_line_odometry
