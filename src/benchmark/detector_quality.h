#pragma once

/// \file
/// Quality of the segments of a line detector: repeatability in another view, and distance from the
/// sub-pixel edge. Independent of the detector's method, so that any two can be compared.

#include <cstddef>
#include <opencv2/core.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Limits of repeatability and of edges.
struct QualityOptions {
  double min_length_px = 20.0;   ///< shorter segments are left out
  double max_normal_px = 2.0;    ///< largest distance along the normal, mean of both ends
  double max_angle_deg = 5.0;    ///< largest difference of direction
  double min_overlap = 0.5;      ///< share of the shorter segment that both must have in common
  double search_px = 3.0;        ///< search range of the edge along the normal, to either side
  double min_edge_contrast = 2;  ///< weakest edge [grey levels / px], in the image smoothed by 1 px
};

/// The pyramid of an image that segments are tracked from or to.
class TrackingImage {
 public:
  /// \param image CV_8UC1.
  explicit TrackingImage(const cv::Mat& image);

  const std::vector<cv::Mat>& pyramid() const { return pyramid_; }

 private:
  std::vector<cv::Mat> pyramid_;
};

/// Initial values of tracking: disparity of each pixel to the other image, CV_32FC1 [px], positive
/// if it is further right in this one, for either direction. Empty: 0.
struct TrackingStart {
  cv::Mat there;  ///< for pixels of the first image
  cv::Mat back;   ///< for pixels of the second image
};

/// Initial values for tracking from the left to the right image of a rectified pair, whose
/// disparities are too large for tracking from 0: by dense matching (cv::StereoSGBM), once from the
/// left image and once from the right one.
TrackingStart startFromDisparity(const cv::Mat& left, const cv::Mat& right);

/// Tracks each segment of one image to another; nothing for those that cannot be tracked.
/// Points along a segment are tracked forward and back by pyramidal Lucas-Kanade. A point counts if
/// it returns to within 0.5 px along the normal; along the segment it may slide (aperture problem).
/// Two thirds of the points must count and lie within 1 px of one line, which is the segment's; its
/// ends are moved along it as the points did.
std::vector<std::optional<LineSegment>> trackSegments(const TrackingImage& from,
                                                      const TrackingImage& to,
                                                      const std::vector<LineSegment>& segments,
                                                      const TrackingStart& start = {});

/// True if two segments of one image are the same: near, parallel (either sense) and overlapping,
/// within the limits of the options.
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

/// Repeatability of the segments of one image among those of another.
/// \param tracked by trackSegments(), one for each segment of the first image.
Repeatability measureRepeatability(const std::vector<std::optional<LineSegment>>& tracked,
                                   const std::vector<LineSegment>& others,
                                   const QualityOptions& options);

/// Signed distances [px] from segments to their sub-pixel edges, along the normal (-direction.y,
/// direction.x). Each pixel of a segment's length is a sample: the offset along the normal with the
/// largest gradient, in the image smoothed by a Gaussian of 1 px, of the sign that the mean
/// gradient of the segment has; interpolated by a parabola between offsets 0.5 px apart. Samples
/// without a clear maximum, i.e. too weak or at the end of the search, are left out.
struct EdgeOffsets {
  std::size_t samples = 0;         ///< all
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

/// Segments of at least min_length_px, the longest first.
std::vector<LineSegment> longSegments(std::vector<LineSegment> segments,
                                      const QualityOptions& options);

/// Sum of lengths [px].
double totalLength_px(const std::vector<LineSegment>& segments);

}  // namespace point_line_odometry
