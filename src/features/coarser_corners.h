#pragma once

#include <vector>

#include "common/thread_pool.h"
#include "features/feature_mask.h"
#include "features/features.h"
#include "features/image_pyramid.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// [px of a level] no corner is nearer to the border: half a patch, and a reserve for its
/// alignment.
constexpr int kCoarserBorder = 10;

/// Corners of the coarser levels of a pyramid (Shi and Tomasi 1994: local maxima of the smaller
/// eigenvalue of the structure tensor) that stand out from the image's noise, bucketed: the
/// strongest of each cell (points/cell_size_px), whatever its level. FAST compares single pixels;
/// the structure tensor sums the gradients of many, so that it is less sensitive to noise.
///
/// Keypoints without orientation and descriptor; pixels in the full-resolution image, centred on a
/// pixel of their level. In the order of octaves, within one in the order of cells.
/// \param threads or null. \param mask with the levels of the pyramid.
std::vector<Keypoint> detectCoarserCorners(const ImagePyramid& pyramid,
                                           const PointParameters& parameters, ThreadPool* threads,
                                           const FeatureMask& mask = {});

}  // namespace point_line_odometry
