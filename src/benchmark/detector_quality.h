#pragma once

/// \file
/// How good the segments of a line detector are: are they found again in another view, and do they
/// lie on the edge? Nothing here depends on how a detector works, so that any two can be compared.

#include <cstddef>
#include <opencv2/core.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "point_line_odometry/features.h"

namespace point_line_odometry {

/// What counts as found again, and as an edge.
struct QualityOptions {
  double min_length_px = 20.0;  ///< shorter segments are left out
  double max_across_px = 2.0;   ///< largest distance across the line, mean of both ends
  double max_angle_deg = 5.0;   ///< largest difference of direction
  double min_overlap = 0.5;     ///< share of the shorter segment that both must have in common
  double search_px = 3.0;  ///< how far from the segment, to either side, its edge is looked for
  double min_edge_contrast = 2;  ///< weakest edge [grey levels / px], in the image smoothed by 1 px
};

/// An image that segments are tracked from or to: its pyramid, made once.
class TrackingImage {
 public:
  /// \param image CV_8UC1.
  explicit TrackingImage(const cv::Mat& image);

  const std::vector<cv::Mat>& pyramid() const { return pyramid_; }

 private:
  std::vector<cv::Mat> pyramid_;
};

/// Where tracking begins: how far each pixel is to the right of its place in the other image, as
/// CV_32FC1 [px], for either direction. Empty: at the same place.
struct TrackingStart {
  cv::Mat there;  ///< for pixels of the first image
  cv::Mat back;   ///< for pixels of the second image
};

/// Start of tracking from the left to the right image of a rectified pair, whose disparities are
/// too large to be tracked without: by dense matching (cv::StereoSGBM), once from the left image
/// and once from the right one.
TrackingStart startFromDisparity(const cv::Mat& left, const cv::Mat& right);

/// Where each segment of one image is in another image, nothing for those that cannot be tracked.
/// Points along a segment are tracked forward and back by pyramidal Lucas-Kanade. A point counts if
/// it comes back to within 0.5 px across the segment; along it a point may slide, as points of an
/// edge do. Two thirds of the points must count and lie within 1 px of one line, which is the
/// segment's; its ends are moved along it as the points did.
std::vector<std::optional<LineSegment>> trackSegments(const TrackingImage& from,
                                                      const TrackingImage& to,
                                                      const std::vector<LineSegment>& segments,
                                                      const TrackingStart& start = {});

/// True if two segments of one image are the same: near, of one direction (either sense) and side
/// by side, within the limits of the options.
bool sameSegment(const LineSegment& a, const LineSegment& b, const QualityOptions& options);

/// Of `total` segments, `tracked` could be tracked to another image, and of these `found` were
/// detected there.
struct Repeatability {
  std::size_t total = 0;
  std::size_t tracked = 0;
  std::size_t found = 0;

  void add(const Repeatability& other);

  /// Share of the tracked segments that were found again, 0 if none was tracked.
  double share() const;

  /// Share of all segments that could be tracked, 0 if there are none.
  double trackedShare() const;
};

/// How many of the segments of one image are found again among those of another.
/// \param tracked by trackSegments(), one for each segment of the first image.
Repeatability measureRepeatability(const std::vector<std::optional<LineSegment>>& tracked,
                                   const std::vector<LineSegment>& others,
                                   const QualityOptions& options);

/// Signed distances [px] from segments to the sub-pixel edges that they stand for, along the normal
/// (-direction.y, direction.x). Each pixel of a segment's length is a sample: the place across it
/// where the grey level, in the image smoothed by a Gaussian of 1 px, changes fastest in the sense
/// in which it changes on average along the segment; between places 0.5 px apart by a parabola.
/// Samples without a clear maximum, i.e. too weak or at the end of the search, are left out.
struct EdgeOffsets {
  std::size_t samples = 0;         ///< looked at
  std::vector<double> offsets_px;  ///< of those that have an edge

  void add(const EdgeOffsets& other);

  /// Root mean square and median absolute distance, 0 without samples.
  double rms_px() const;
  double median_px() const;

  /// Share of the samples that have an edge, 0 without samples.
  double edgeShare() const;
};

/// \param smooth image as CV_32FC1, from smoothForEdges().
EdgeOffsets measureEdgeOffsets(const cv::Mat& smooth, const std::vector<LineSegment>& segments,
                               const QualityOptions& options);

/// A CV_8UC1 image after a Gaussian of 1 px, as CV_32FC1.
cv::Mat smoothForEdges(const cv::Mat& image);

/// Segments longer than the options' shortest, the longest first.
std::vector<LineSegment> longSegments(std::vector<LineSegment> segments,
                                      const QualityOptions& options);

/// Sum of lengths [px].
double totalLength_px(const std::vector<LineSegment>& segments);

}  // namespace point_line_odometry
