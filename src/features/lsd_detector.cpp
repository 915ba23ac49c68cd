#include "features/lsd_detector.h"

#include <stdexcept>

#include "common/opencv_lsd.h"
#include "features/longest_segments.h"

namespace point_line_odometry {
namespace {

// LSD scales the image by 0.8 and maps a pixel u of it back to u / 0.8; with pixels' centres at
// integers it is (u + 0.5) / 0.8 - 0.5.
constexpr float kShift = 0.5F / 0.8F - 0.5F;

}  // namespace

bool LsdDetector::isAvailable() { return !createLsd().empty(); }

LsdDetector::LsdDetector(const LineParameters& parameters)
    : parameters_(parameters), lsd_(createLsd()) {
  if (lsd_.empty()) throw std::runtime_error("this OpenCV has no line segment detector");
}

/// LSD's segments have the brighter side on the left: start and end are swapped.
std::vector<LineSegment> LsdDetector::detect(const cv::Mat& image, const FeatureMask& mask) const {
  std::vector<cv::Vec4f> lines;
  lsd_->detect(image, lines);
  std::vector<LineSegment> segments;
  segments.reserve(lines.size());
  for (const cv::Vec4f& line : lines) {
    const LineSegment segment{{line[2] + kShift, line[3] + kShift},
                              {line[0] + kShift, line[1] + kShift}};
    if (segment.length() >= parameters_.min_length_px) segments.push_back(segment);
  }
  mask.cut(parameters_.min_length_px, &segments);
  keepLongest(parameters_.max_count, &segments);
  return segments;
}

LineDetectorKind lineDetectorKind(const LineParameters& parameters,
                                  const std::function<bool()>& lsd_is_available) {
  if (!parameters.enabled) return LineDetectorKind::kNone;
  const bool lsd = parameters.detector == "lsd" ||
                   (parameters.detector == "lsd_or_edge_chains" && lsd_is_available());
  return lsd ? LineDetectorKind::kLsd : LineDetectorKind::kEdgeChains;
}

}  // namespace point_line_odometry
