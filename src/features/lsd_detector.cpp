#include "point_line_odometry/lsd_detector.h"

#include <stdexcept>

#include "features/longest_segments.h"

namespace point_line_odometry {
namespace {

// LSD looks at the image at 0.8 of its size, and takes u / 0.8 for the place of u there; between
// the centres of pixels it is (u + 0.5) / 0.8 - 0.5.
constexpr float kShift = 0.5F / 0.8F - 0.5F;

}  // namespace

cv::Ptr<cv::LineSegmentDetector> createLsd() {
  try {
    cv::Ptr<cv::LineSegmentDetector> lsd = cv::createLineSegmentDetector(cv::LSD_REFINE_STD);
    cv::Mat lines;
    lsd->detect(cv::Mat::zeros(32, 32, CV_8UC1), lines);
    return lsd;
  } catch (const cv::Exception&) {
    return {};
  }
}

bool LsdDetector::isAvailable() { return !createLsd().empty(); }

LsdDetector::LsdDetector(const LineParameters& parameters)
    : parameters_(parameters), lsd_(createLsd()) {
  if (lsd_.empty()) throw std::runtime_error("this OpenCV has no line segment detector");
}

/// LSD walks with the brighter side on the left hand.
std::vector<LineSegment> LsdDetector::detect(const cv::Mat& image) const {
  std::vector<cv::Vec4f> lines;
  lsd_->detect(image, lines);
  std::vector<LineSegment> segments;
  segments.reserve(lines.size());
  for (const cv::Vec4f& line : lines) {
    const LineSegment segment{{line[2] + kShift, line[3] + kShift},
                              {line[0] + kShift, line[1] + kShift}};
    if (segment.length() >= parameters_.min_length_px) segments.push_back(segment);
  }
  keepLongest(parameters_.max_count, &segments);
  return segments;
}

const char* toString(LineDetectorKind kind) {
  switch (kind) {
    case LineDetectorKind::kNone:
      return "none";
    case LineDetectorKind::kEdgeChains:
      return "edge_chains";
    case LineDetectorKind::kLsd:
      return "lsd";
  }
  return "unknown";
}

LineDetectorKind lineDetectorKind(const LineParameters& parameters,
                                  const std::function<bool()>& lsd_is_available) {
  if (!parameters.enabled) return LineDetectorKind::kNone;
  const bool lsd = parameters.detector == "lsd" ||
                   (parameters.detector == "lsd_or_edge_chains" && lsd_is_available());
  return lsd ? LineDetectorKind::kLsd : LineDetectorKind::kEdgeChains;
}

}  // namespace point_line_odometry
