#pragma once

/// \file
/// Filters of sources of stereo pairs: masks, fewer frames, other image sizes.

#include <cstddef>
#include <memory>

#include "dataset/mask_file.h"
#include "tools/stereo_source.h"

namespace point_line_odometry {

/// Every nth pair of a source (n at least 1), starting with the first one: a lower frame rate.
std::unique_ptr<StereoSource> everyNth(std::unique_ptr<StereoSource> source, std::size_t n);

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
