#pragma once

/// \file
/// Filters of sources of stereo pairs: another calibration, masks, fewer frames, other image sizes.

#include <array>
#include <cstddef>
#include <memory>
#include <string>

#include "dataset/mask_file.h"
#include "tools/stereo_source.h"

namespace point_line_odometry {

/// Every nth pair of a source (n at least 1), starting with the first one: a lower frame rate.
std::unique_ptr<StereoSource> everyNth(std::unique_ptr<StereoSource> source, std::size_t n);

/// Files of camera_calibration (see readCameraInfo()) of the left and the right camera; empty: the
/// source's own calibration.
using CameraInfoFiles = std::array<std::string, 2>;

/// The pairs of a source with another calibration. Images that are rectified already are rectified
/// once more by it, where it has a distortion or a rotation. Throws InputError if a file cannot be
/// used for the source's images, or if these were rectified from raw ones, to which it would
/// belong.
std::unique_ptr<StereoSource> calibrated(std::unique_ptr<StereoSource> source,
                                         const CameraInfoFiles& files);

/// Which masks are used.
struct MaskRequest {
  MaskFiles files{kNoMask, kNoMask};
  bool of_source = false;  ///< those that come with the images
};

/// The pairs of a source with these masks only. Throws InputError if a file cannot be used for the
/// source's images.
std::unique_ptr<StereoSource> masked(std::unique_ptr<StereoSource> source,
                                     const MaskRequest& request);

/// The pairs of a source with images and masks scaled by `factor`.
std::unique_ptr<StereoSource> scaled(std::unique_ptr<StereoSource> source, double factor);

}  // namespace point_line_odometry
