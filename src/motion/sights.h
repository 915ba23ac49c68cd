#pragma once

#include <optional>

#include "matching/patch_warp.h"
#include "motion/noise_scale.h"
#include "point_line_odometry/calibration_refinement.h"
#include "point_line_odometry/matching.h"
#include "point_line_odometry/motion.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// What turns features of the current frame into measurements; refers to what it is made of.
struct FrameContext {
  const StereoImages& images;
  const StereoCamera& camera;
  const RightImageCorrection& correction;  ///< of what is seen in the right image
  const Parameters& parameters;
  NoiseScale noise = {};
  /// The images, and their coarser levels where points of those are in use.
  ImagePyramid left = ImagePyramid(images.left);
  ImagePyramid right = ImagePyramid(images.right);
};

/// Noise of a coordinate of a point's pixel [px]: what no patch shows of itself, in pixels of its
/// level, and that of its alignment. \param scale of the pyramid level in which the point was
/// found.
double pointSigma(const FrameContext& context, double alignment_noise_px, double scale);

/// Noise of a segment's end points across it [px]: how far the edge is from straight, and the noise
/// of the edge's pixels, of which there is about one for each pixel of length. The ends of a line
/// fitted to n samples have twice their noise by the square root of n. Of a stereo pair the shorter
/// segment counts.
double lineSigma(const FrameContext& context, const LineSegment& left, const LineSegment& right);

/// A stereo line of a frame as a measurement.
LineSight lineSight(const DetectedFeatures& features, const StereoLine& line,
                    const FrameContext& context);

/// The place where a point of the map or of an earlier frame is seen: its patch is aligned in both
/// images of the current frame, from where it is expected. Nothing if it is not found in both.
/// \param octave of the patch, and of the images in which it is looked for.
std::optional<PointSight> alignPoint(const StereoPatch& patch, int octave,
                                     const Eigen::Vector2f& left_px,
                                     const Eigen::Vector2f& right_px, const FrameContext& context);

/// Aligns a patch of an octave in that of an image. \param initial_px and the result are pixels of
/// the image itself.
std::optional<AlignedPatch> alignInOctave(const PatchAligner& patch, const ImagePyramid& image,
                                          int octave, const Eigen::Vector2f& initial_px);

}  // namespace point_line_odometry
