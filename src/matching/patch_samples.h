#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <optional>

#include "point_line_odometry/matching.h"

namespace point_line_odometry {

/// \file
/// What patches look like between the pixels, for PatchAligner.
///
/// A bilinear sample is a mean of pixels: at a share f of the way from one to the next it is
/// blurred with a variance of f (1 - f) px^2. Patches that are compared lie anywhere between the
/// pixels, and one that is sharper than another looks as if it were narrower, and its corners
/// elsewhere. So all but slanted ones, whose pixels lie at all places, are blurred as much as
/// samples are on the average of all places: with 1/6 px^2 along either axis.
///
/// None is sampled if a pixel that is read would lie outside of the image.

/// Largest change of the columns per pixel that sampleSlantedPatch() can follow.
constexpr float kMaxPatchSlope = 0.7F;

/// The patch round a place. Returns false if it leaves the image.
bool samplePatch(const cv::Mat& image, const Eigen::Vector2f& centre, PatchAligner::Patch* values);

/// The patch at the place and with the slope at which it is seen. Returns false if it leaves the
/// image.
bool sampleSlantedPatch(const cv::Mat& image, const AlignedPatch& seen,
                        PatchAligner::Patch* values);

/// The patch round a place with the border that its gradients need.
std::optional<PatchAligner::WidePatch> sampleWidePatch(const cv::Mat& image,
                                                       const Eigen::Vector2f& pixel);

/// The same with its pixels `source_by_target` apart.
std::optional<PatchAligner::WidePatch> sampleWidePatch(const cv::Mat& image,
                                                       const Eigen::Vector2f& pixel,
                                                       const Eigen::Matrix2f& source_by_target);

}  // namespace point_line_odometry
