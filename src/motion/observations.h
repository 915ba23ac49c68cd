#pragma once

#include <optional>

#include "features/features.h"
#include "matching/patch_aligner.h"
#include "matching/patch_warp.h"
#include "matching/stereo_frame.h"
#include "motion/correspondence.h"
#include "motion/frame_context.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Pixels of the image per pixel of the pyramid level in which a keypoint was detected.
double levelScale(const Keypoint& keypoint, const Parameters& parameters);

/// Standard deviation of a coordinate of a point's pixel [px]: motion/point_noise_px, in pixels of
/// its level, and the noise of its alignment. \param scale of the pyramid level in which the point
/// was detected.
double pointSigma(const FrameContext& context, double alignment_noise_px, double scale);

/// The observation of a point at its pixels in the two images, as of a calibrated camera at the
/// stamp.
PointObservation pointObservation(const Eigen::Vector2f& left_px, const Eigen::Vector2f& right_px,
                                  double sigma_px, const FrameContext& context);

/// The same for a line at its segments. \param scale of the pyramid level that they are of.
LineObservation lineObservation(const LineSegment& left, const LineSegment& right, double scale,
                                const FrameContext& context);

/// The same for a stereo line of a frame.
LineObservation lineObservation(const DetectedFeatures& features, const StereoLine& line,
                                const FrameContext& context);

/// The observation of a point of the map or of an earlier frame: its patch is aligned in both
/// images of the current frame, from the predicted pixels. Nothing if one of them fails.
/// \param octave of the patch, and of the images in which it is aligned.
std::optional<PointObservation> alignPoint(const StereoPatch& patch, int octave,
                                           const Eigen::Vector2f& left_px,
                                           const Eigen::Vector2f& right_px,
                                           const FrameContext& context);

/// Aligns a patch of an octave in that of an image. \param initial_px and the result are pixels of
/// the image itself.
std::optional<AlignedPatch> alignInOctave(const PatchAligner& patch, const ImagePyramid& image,
                                          const FeatureMask& mask, int octave,
                                          const Eigen::Vector2f& initial_px);

}  // namespace point_line_odometry
