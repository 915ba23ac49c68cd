#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <optional>

#include "matching/patch_aligner.h"

namespace point_line_odometry {

/// \file
/// Samples of patches at sub-pixel positions, for PatchAligner.
///
/// A bilinear sample is a weighted mean of pixels: at a fraction f between two of them it is
/// blurred with a variance of f (1 - f) px^2. Patches of different sub-pixel positions are blurred
/// differently, which biases their alignment. So all but slanted ones, whose samples have all
/// fractions, are blurred to the mean of f (1 - f): 1/6 px^2 along either axis.
///
/// No patch is sampled that needs a pixel outside of the image.

/// Largest slope that sampleSlantedPatch() supports.
constexpr float kMaxPatchSlope = 0.7F;

/// The patch around a pixel. Returns false if it leaves the image.
bool samplePatch(const cv::Mat& image, const Eigen::Vector2f& centre, PatchAligner::Patch* values);

/// The patch at an aligned position and slope. Returns false if it leaves the image.
bool sampleSlantedPatch(const cv::Mat& image, const AlignedPatch& seen,
                        PatchAligner::Patch* values);

/// The patch around a pixel with the border that its gradients need.
std::optional<PatchAligner::WidePatch> sampleWidePatch(const cv::Mat& image,
                                                       const Eigen::Vector2f& pixel);

/// The same under an affine warp: Jacobian of the image's pixels by the patch's pixels.
std::optional<PatchAligner::WidePatch> sampleWidePatch(const cv::Mat& image,
                                                       const Eigen::Vector2f& pixel,
                                                       const Eigen::Matrix2f& warp);

}  // namespace point_line_odometry
