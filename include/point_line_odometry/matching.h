#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "point_line_odometry/features.h"
#include "point_line_odometry/image_pyramid.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/thread_pool.h"
#include "point_line_odometry/triangulation.h"

namespace point_line_odometry {

/// Indices into two lists whose elements are the same thing.
struct IndexPair {
  int first = -1;
  int second = -1;
};

/// Where one pixel to the right and one down in an image lead on a surface: columns in the frame of
/// a camera or of the map [m].
using PixelAxes = Eigen::Matrix<double, 3, 2>;

/// A point seen in both images of one stereo frame.
struct StereoPoint {
  int left = -1;   ///< index into DetectedFeatures::points_left
  int right = -1;  ///< index into DetectedFeatures::points_right
  Eigen::Vector2f right_px =
      Eigen::Vector2f::Zero();  ///< sub-pixel place in the right image, as seen
  double sigma_px = 1.0;        ///< of each pixel coordinate
  TriangulatedPoint triangulated;
  /// Where one pixel to the right and one down in the left image lead on its surface [m].
  PixelAxes pixel_axes = PixelAxes::Zero();
  bool far = false;  ///< too far for a disparity: it tells rotations only
};

/// A segment seen in both images of one stereo frame. Some cannot be triangulated: near the
/// epipolar direction.
struct StereoLine {
  int left = -1;   ///< index into DetectedFeatures::lines_left
  int right = -1;  ///< index into DetectedFeatures::lines_right
  std::optional<TriangulatedLine> triangulated;
};

/// One stereo frame after detection, stereo matching and triangulation; the next frame is matched
/// with it.
struct StereoFrame {
  std::int64_t stamp_ns = 0;
  ImagePyramid left_image;  ///< a copy: sub-pixel matching of the next frames looks at it
  DetectedFeatures features;
  std::vector<StereoPoint> points;
  std::vector<StereoLine> lines;
};

/// Pairs of points (left, right) within the epipolar window delta_u x delta_v, each the other's
/// best descriptor.
std::vector<IndexPair> matchPointsStereo(const std::vector<PointFeature>& left,
                                         const std::vector<PointFeature>& right,
                                         const MatchingParameters& parameters, ThreadPool* threads);

/// Pairs of segments (left, right) of like direction that share rows, each the other's best
/// descriptor.
std::vector<IndexPair> matchLinesStereo(const std::vector<LineFeature>& left,
                                        const std::vector<LineFeature>& right,
                                        const MatchingParameters& parameters);

/// Pairs (left, right) of features of one stereo frame.
struct StereoMatches {
  std::vector<IndexPair> points;
  std::vector<IndexPair> lines;
};

/// Both of the above.
StereoMatches matchStereo(const DetectedFeatures& features, const MatchingParameters& parameters,
                          ThreadPool* threads);

/// Where features are expected in frame k, and how far from there they are looked for.
struct MotionPrediction {
  Eigen::Isometry3d T_curr_prev = Eigen::Isometry3d::Identity();
  double radius_px = 25.0;
};

/// A point that was seen before, and where it should be in the images of frame k.
struct ExpectedPoint {
  Eigen::Vector2f left_px = Eigen::Vector2f::Zero();
  Eigen::Vector2f right_px = Eigen::Vector2f::Zero();
  Descriptor left_descriptor{};
  Descriptor right_descriptor{};
};

/// The same for a line.
struct ExpectedLine {
  LineSegment left;
  LineSegment right;
  Descriptor left_descriptor{};
  Descriptor right_descriptor{};
};

/// Segments of a line whose end points are these in the current left camera [m]; the descriptors
/// are for the caller to fill in. Nothing if it is behind the camera or not within the left image
/// and a margin.
std::optional<ExpectedLine> expectLine(const StereoCamera& camera, const Eigen::Vector3d& start,
                                       const Eigen::Vector3d& end, double margin_px);

/// Pairs (expected, stereo point of frame k): the right leg's best descriptor in a disc leads to a
/// stereo point whose left leg's best leads back.
std::vector<IndexPair> matchExpectedPoints(const std::vector<ExpectedPoint>& expected,
                                           const StereoFrame& curr, double radius_px,
                                           const MatchingParameters& parameters);

/// The same for stereo lines, with the appearance-geometry constraint (paper, section 3).
std::vector<IndexPair> matchExpectedLines(const std::vector<ExpectedLine>& expected,
                                          const StereoFrame& curr, double radius_px,
                                          const MatchingParameters& parameters);

/// What a point looks like in both images of a stereo frame.
struct StereoDescriptor {
  Descriptor left{};
  Descriptor right{};
};

/// Pairs (known, stereo point of frame k) of the nearest descriptors over the whole image, wherever
/// the camera has moved: Hamming distances of left and right together, cross-check and ratio test.
std::vector<IndexPair> matchPointsByAppearance(const std::vector<StereoDescriptor>& known,
                                               const StereoFrame& curr,
                                               const MatchingParameters& parameters);

/// The descriptors of the stereo points of a frame.
std::vector<StereoDescriptor> stereoDescriptors(const StereoFrame& frame);

/// Pairs of stereo points (k-1, k) whose circle l(k-1) -> r(k-1) -> r(k) -> l(k) -> l(k-1) closes
/// (paper, section 2): the legs within a frame are the stereo pairs, those between frames the best
/// descriptors near the predicted place (paper, eq. 1).
std::vector<IndexPair> matchPointsCircular(const StereoFrame& prev, const StereoFrame& curr,
                                           const StereoCamera& camera,
                                           const MotionPrediction& prediction,
                                           const MatchingParameters& parameters);

/// The same for triangulated stereo lines of frame k-1, with the appearance-geometry constraint
/// (paper, section 3).
std::vector<IndexPair> matchLinesCircular(const StereoFrame& prev, const StereoFrame& curr,
                                          const StereoCamera& camera,
                                          const MotionPrediction& prediction,
                                          const MatchingParameters& parameters);

/// Pairs (k-1, k) of stereo points and of stereo lines.
struct CircularMatches {
  std::vector<IndexPair> points;
  std::vector<IndexPair> lines;
};

/// Both of the above.
CircularMatches matchCircular(const StereoFrame& prev, const StereoFrame& curr,
                              const StereoCamera& camera, const MotionPrediction& prediction,
                              const MatchingParameters& parameters);

/// Where a patch is seen in another image: its row with offset y at columns
/// pixel.x + (1 + slope.x) x + slope.y y.
struct AlignedPatch {
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();  ///< its centre
  Eigen::Vector2f slope = Eigen::Vector2f::Zero();
  /// Standard deviation of each coordinate: by what the alignment leaves unexplained of the
  /// brightness, and the contrast. What is not aligned is known to a whole pixel.
  double noise_px = std::sqrt(1.0 / 12.0);
};

/// Aligns the patch round a pixel of one image, 11 x 11 px, with others by translation (inverse
/// compositional Lucas-Kanade with the mean brightness removed).
class PatchAligner {
 public:
  static constexpr int kSide = 11;
  static constexpr int kPitch = 12;        ///< of rows in memory: the last column is not used
  static constexpr int kWide = kSide + 2;  ///< with what the gradients of the border need
  using Patch = std::array<float, kSide * kPitch>;
  using WidePatch = std::array<float, kWide * kWide>;

  /// \param image CV_8UC1. \param pixel centre of the patch.
  PatchAligner(const cv::Mat& image, const Eigen::Vector2f& pixel);

  /// The patch as it would look from elsewhere.
  /// \param source_by_target pixels of the image per pixel of the patch.
  PatchAligner(const cv::Mat& image, const Eigen::Vector2f& pixel,
               const Eigen::Matrix2f& source_by_target);

  /// The patch in the target, without slopes. Nothing if it does not converge near the initial
  /// place, the patches differ, or the patch has no corner.
  std::optional<AlignedPatch> align(const cv::Mat& target, const Eigen::Vector2f& initial_px) const;

  /// The same for a patch of the left image of a rectified pair in the right one, of a surface that
  /// need not face the cameras: road and walls are seen sheared and narrowed. Nothing, too, if one
  /// surface does not explain the patch.
  std::optional<AlignedPatch> alignSlanted(const cv::Mat& target,
                                           const Eigen::Vector2f& initial_px) const;

 private:
  void prepare(const WidePatch& wide);
  float residual(Patch* values) const;  // RMS [grey levels]; spoils the values
  double noise(float residual) const;   // of a coordinate [px]

  Patch brightness_;  // each less its mean
  Patch gx_;
  Patch gy_;
  float mean_gx_ = 0.0F;
  Eigen::Vector2f at_brightness_;  // products of the gradients and the brightness
  Eigen::Matrix2f inverse_hessian_ = Eigen::Matrix2f::Zero();
  bool usable_ = false;
};

}  // namespace point_line_odometry
