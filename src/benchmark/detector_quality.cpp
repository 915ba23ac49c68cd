#include "benchmark/detector_quality.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include "common/statistics.h"

namespace point_line_odometry {
namespace {

const cv::Size kWindow(21, 21);
constexpr int kMaxLevel = 5;                   // of the pyramid
constexpr int kMaxLevelFromStart = 2;          // with a start near the solution
constexpr int kMaxDisparity = 160;             // [px], a multiple of 16
constexpr double kMinEigenvalue = 1e-6;        // points of an edge slide along it, and are kept
constexpr double kMaxReturnAlongNormal = 0.5;  // [px]
constexpr double kMaxFromLine = 1.0;           // [px]
constexpr double kMinPointShare = 2.0 / 3.0;
constexpr float kPointSpacing = 4.0F;  // [px]
constexpr int kMinPoints = 6;          // on a segment
constexpr int kMaxPoints = 30;         // on a segment
constexpr double kMaxStretch = 2.0;    // of a segment's length from one image to the other
constexpr double kSampleStep = 0.5;    // along the normal of an edge [px]
constexpr float kMargin = 2.0F;        // of bicubic interpolation [px]

Eigen::Vector2f normalOf(const LineSegment& segment) {
  const Eigen::Vector2f direction = segment.direction();
  return {-direction.y(), direction.x()};
}

/// Distance of a point to the endless line of a segment.
double normalDistance(const LineSegment& segment, const Eigen::Vector2f& point) {
  return std::abs(normalOf(segment).dot(point - segment.start));
}

/// Points on all segments, and those of segment i in [begins[i], begins[i + 1]).
struct SegmentPoints {
  std::vector<cv::Point2f> points;
  std::vector<std::size_t> begins{0};
};

SegmentPoints pointsOn(const std::vector<LineSegment>& segments) {
  SegmentPoints sampled;
  for (const LineSegment& segment : segments) {
    const int n =
        std::clamp(static_cast<int>(segment.length() / kPointSpacing) + 1, kMinPoints, kMaxPoints);
    for (int i = 0; i < n; ++i) {
      const float t = static_cast<float>(i) / static_cast<float>(n - 1);
      const Eigen::Vector2f p = segment.start + t * (segment.end - segment.start);
      sampled.points.emplace_back(p.x(), p.y());
    }
    sampled.begins.push_back(sampled.points.size());
  }
  return sampled;
}

/// \param start shift of each pixel, or empty.
std::vector<cv::Point2f> trackPoints(const TrackingImage& from, const TrackingImage& to,
                                     const std::vector<cv::Point2f>& points, const cv::Mat& start,
                                     std::vector<std::uint8_t>* found) {
  std::vector<cv::Point2f> tracked = points;
  const cv::Rect image(cv::Point(), start.size());
  for (cv::Point2f& point : tracked) {
    const cv::Point pixel(cvRound(point.x), cvRound(point.y));
    if (image.contains(pixel)) point.x -= start.at<float>(pixel);
  }
  std::vector<float> error;
  const cv::TermCriteria criteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 30, 0.01);
  cv::calcOpticalFlowPyrLK(from.pyramid(), to.pyramid(), points, tracked, *found, error, kWindow,
                           start.empty() ? kMaxLevel : kMaxLevelFromStart, criteria,
                           cv::OPTFLOW_USE_INITIAL_FLOW, kMinEigenvalue);
  return tracked;
}

/// Disparity of each pixel of the left image [px]; where there is none the largest one near it (an
/// edge belongs to the object in front), or else 0.
cv::Mat denseDisparity(const cv::Mat& left, const cv::Mat& right) {
  constexpr int kBlock = 5;
  constexpr int kSmooth = 8 * kBlock * kBlock;
  const auto matcher = cv::StereoSGBM::create(0, kMaxDisparity, kBlock, kSmooth, 4 * kSmooth, 2, 63,
                                              10, 100, 2, cv::StereoSGBM::MODE_SGBM_3WAY);
  // StereoSGBM leaves out as many columns at the left as there are disparities.
  cv::Mat wide_left;
  cv::Mat wide_right;
  cv::copyMakeBorder(left, wide_left, 0, 0, kMaxDisparity, 0, cv::BORDER_REPLICATE);
  cv::copyMakeBorder(right, wide_right, 0, 0, kMaxDisparity, 0, cv::BORDER_REPLICATE);
  cv::Mat sixteenths;
  matcher->compute(wide_left, wide_right, sixteenths);
  sixteenths = sixteenths.colRange(kMaxDisparity, sixteenths.cols).clone();
  cv::Mat near;
  cv::dilate(sixteenths, near, cv::Mat::ones(7, 7, CV_8UC1));
  near.copyTo(sixteenths, sixteenths < 0);
  cv::Mat disparity;
  cv::max(sixteenths, 0, sixteenths);
  sixteenths.convertTo(disparity, CV_32F, 1.0 / cv::StereoMatcher::DISP_SCALE);
  return disparity;
}

cv::Mat mirrored(const cv::Mat& image) {
  cv::Mat result;
  cv::flip(image, result, 1);
  return result;
}

/// A point of a segment and its pixel in the other image.
struct TrackedPoint {
  double along = 0.0;  // from the segment's start, before [px]
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();
};

/// Robust linear map of positions along a line, y = offset + slope * x. The slope is the median
/// over pairs of points half the list apart (Theil-Sen estimator).
struct AlongMap {
  double offset = 0.0;
  double slope = 1.0;

  AlongMap(const std::vector<double>& x, const std::vector<double>& y) {
    std::vector<double> slopes;
    const std::size_t half = x.size() / 2;
    for (std::size_t i = 0; i + half < x.size(); ++i) {
      slopes.push_back((y[i + half] - y[i]) / (x[i + half] - x[i]));
    }
    slope = std::clamp(median(slopes), 1.0 / kMaxStretch, kMaxStretch);
    std::vector<double> offsets;
    for (std::size_t i = 0; i < x.size(); ++i) offsets.push_back(y[i] - slope * x[i]);
    offset = median(offsets);
  }
};

/// The segment through tracked points of which `needed` must lie on one line.
std::optional<LineSegment> segmentThrough(const std::vector<TrackedPoint>& points, double length,
                                          std::size_t needed) {
  if (points.size() < needed) return std::nullopt;
  std::vector<cv::Point2f> pixels;
  for (const TrackedPoint& point : points) pixels.emplace_back(point.pixel.x(), point.pixel.y());
  cv::Vec4f line;
  cv::fitLine(pixels, line, cv::DIST_HUBER, 0, 0.01, 0.01);
  Eigen::Vector2f direction(line[0], line[1]);
  if (direction.dot(points.back().pixel - points.front().pixel) < 0.0F) direction = -direction;
  const Eigen::Vector2f origin(line[2], line[3]);
  const LineSegment whole{origin, origin + direction};
  std::vector<double> before;
  std::vector<double> after;
  for (const TrackedPoint& point : points) {
    if (normalDistance(whole, point.pixel) > kMaxFromLine) continue;
    before.push_back(point.along);
    after.push_back(direction.dot(point.pixel - origin));
  }
  if (before.size() < needed) return std::nullopt;
  const AlongMap map(before, after);
  return LineSegment{origin + static_cast<float>(map.offset) * direction,
                     origin + static_cast<float>(map.offset + map.slope * length) * direction};
}

/// Weights of four adjacent pixels for a position t (0 ... 1) between the middle ones
/// (Catmull-Rom).
std::array<float, 4> cubicWeights(float t) {
  const float t2 = t * t;
  const float t3 = t2 * t;
  return {0.5F * (-t + 2.0F * t2 - t3), 0.5F * (2.0F - 5.0F * t2 + 3.0F * t3),
          0.5F * (t + 4.0F * t2 - 3.0F * t3), 0.5F * (t3 - t2)};
}

/// Grey level at a sub-pixel position, bicubic; at least kMargin from the image's border.
/// (Bilinear interpolation would move edges by up to a tenth of a pixel.)
float greyAt(const cv::Mat& image, const Eigen::Vector2f& pixel) {
  const int left = static_cast<int>(pixel.x());
  const int top = static_cast<int>(pixel.y());
  const std::array<float, 4> across = cubicWeights(pixel.x() - static_cast<float>(left));
  const std::array<float, 4> down = cubicWeights(pixel.y() - static_cast<float>(top));
  float grey = 0.0F;
  for (int i = 0; i < 4; ++i) {
    const auto* row = image.ptr<float>(top - 1 + i) + left - 1;
    grey += down[i] *
            (across[0] * row[0] + across[1] * row[1] + across[2] * row[2] + across[3] * row[3]);
  }
  return grey;
}

/// True if a position is at least `margin` px within the outermost pixels' centres.
bool inside(const cv::Mat& image, const Eigen::Vector2f& p, float margin) {
  return p.x() >= margin && p.y() >= margin &&
         p.x() <= static_cast<float>(image.cols - 1) - margin &&
         p.y() <= static_cast<float>(image.rows - 1) - margin;
}

/// Gradient along the normal of a segment [grey levels / px], from -reach to +reach px of a point
/// on it; empty if part of that is outside the image.
std::vector<double> profileAlongNormal(const cv::Mat& smooth, const Eigen::Vector2f& centre,
                                       const Eigen::Vector2f& normal, double reach) {
  const Eigen::Vector2f furthest = static_cast<float>(reach + kSampleStep) * normal;
  if (!inside(smooth, centre - furthest, kMargin) || !inside(smooth, centre + furthest, kMargin)) {
    return {};
  }
  std::vector<float> grey;
  const int n = 2 * static_cast<int>(std::lround(reach / kSampleStep)) + 1;
  for (int i = -1; i <= n; ++i) {
    const auto offset = static_cast<float>(-reach + i * kSampleStep);
    grey.push_back(greyAt(smooth, centre + offset * normal));
  }
  std::vector<double> slopes;
  for (int i = 0; i < n; ++i) slopes.push_back((grey[i + 2] - grey[i]) / (2.0 * kSampleStep));
  return slopes;
}

/// Offset of the largest gradient of the given sign, interpolated by a parabola.
std::optional<double> strongestChange(const std::vector<double>& slopes, double sign,
                                      const QualityOptions& options) {
  const auto best = std::max_element(slopes.begin(), slopes.end(),
                                     [&](double a, double b) { return sign * a < sign * b; });
  if (best == slopes.begin() || std::next(best) == slopes.end()) return std::nullopt;
  const double here = sign * *best;
  const double before = sign * *std::prev(best);
  const double after = sign * *std::next(best);
  const double curvature = before - 2.0 * here + after;
  if (here < options.min_edge_contrast || !(curvature < 0.0)) return std::nullopt;
  const double index =
      static_cast<double>(best - slopes.begin()) + 0.5 * (before - after) / curvature;
  return index * kSampleStep - options.search_px;
}

EdgeOffsets edgeOffsetsOf(const cv::Mat& smooth, const LineSegment& segment,
                          const QualityOptions& options) {
  EdgeOffsets result;
  const Eigen::Vector2f direction = segment.direction();
  const Eigen::Vector2f normal = normalOf(segment);
  const int n = static_cast<int>(segment.length());
  std::vector<std::vector<double>> profiles;
  double sum_on_segment = 0.0;
  for (int i = 0; i < n; ++i) {
    const Eigen::Vector2f p = segment.start + (static_cast<float>(i) + 0.5F) * direction;
    profiles.push_back(profileAlongNormal(smooth, p, normal, options.search_px));
    if (!profiles.back().empty()) sum_on_segment += profiles.back()[profiles.back().size() / 2];
  }
  const double sign = sum_on_segment < 0.0 ? -1.0 : 1.0;
  for (const std::vector<double>& profile : profiles) {
    if (profile.empty()) continue;
    ++result.samples;
    if (const auto offset = strongestChange(profile, sign, options)) {
      result.offsets_px.push_back(*offset);
    }
  }
  return result;
}

double ratio(std::size_t part, std::size_t whole) {
  return whole == 0 ? 0.0 : static_cast<double>(part) / static_cast<double>(whole);
}

}  // namespace

TrackingImage::TrackingImage(const cv::Mat& image) {
  cv::buildOpticalFlowPyramid(image, pyramid_, kWindow, kMaxLevel);
}

TrackingStart startFromDisparity(const cv::Mat& left, const cv::Mat& right) {
  // Mirrored, the right image is the left one of the pair.
  return {denseDisparity(left, right), mirrored(-denseDisparity(mirrored(right), mirrored(left)))};
}

std::vector<std::optional<LineSegment>> trackSegments(const TrackingImage& from,
                                                      const TrackingImage& to,
                                                      const std::vector<LineSegment>& segments,
                                                      const TrackingStart& start) {
  std::vector<std::optional<LineSegment>> result;
  if (segments.empty()) return result;
  const SegmentPoints sampled = pointsOn(segments);
  std::vector<std::uint8_t> found;
  std::vector<std::uint8_t> came_back;
  const std::vector<cv::Point2f> there = trackPoints(from, to, sampled.points, start.there, &found);
  const std::vector<cv::Point2f> back = trackPoints(to, from, there, start.back, &came_back);
  for (std::size_t s = 0; s < segments.size(); ++s) {
    const LineSegment& segment = segments[s];
    std::vector<TrackedPoint> tracked;
    for (std::size_t i = sampled.begins[s]; i < sampled.begins[s + 1]; ++i) {
      const Eigen::Vector2f pixel(there[i].x, there[i].y);
      if (found[i] == 0 || came_back[i] == 0 || !inside(to.pyramid()[0], pixel, 0.0F) ||
          normalDistance(segment, {back[i].x, back[i].y}) > kMaxReturnAlongNormal) {
        continue;
      }
      const Eigen::Vector2f before(sampled.points[i].x, sampled.points[i].y);
      tracked.push_back({(before - segment.start).norm(), pixel});
    }
    const double num_points = static_cast<double>(sampled.begins[s + 1] - sampled.begins[s]);
    result.push_back(
        segmentThrough(tracked, segment.length(),
                       static_cast<std::size_t>(std::ceil(kMinPointShare * num_points))));
  }
  return result;
}

bool sameSegment(const LineSegment& a, const LineSegment& b, const QualityOptions& options) {
  const LineSegment& longer = a.length() >= b.length() ? a : b;
  const LineSegment& shorter = a.length() >= b.length() ? b : a;
  const double cosine = std::abs(longer.direction().dot(shorter.direction()));
  if (cosine < std::cos(options.max_angle_deg * CV_PI / 180.0)) return false;
  const double across =
      0.5 * (normalDistance(longer, shorter.start) + normalDistance(longer, shorter.end));
  if (across > options.max_normal_px) return false;
  const Eigen::Vector2f direction = longer.direction();
  const double s = direction.dot(shorter.start - longer.start);
  const double e = direction.dot(shorter.end - longer.start);
  const double length = longer.length();
  const double common = std::min(length, std::max(s, e)) - std::max(0.0, std::min(s, e));
  return common >= options.min_overlap * shorter.length();
}

void Repeatability::add(const Repeatability& other) {
  total += other.total;
  tracked += other.tracked;
  found += other.found;
}

double Repeatability::share() const { return ratio(found, tracked); }

double Repeatability::trackedShare() const { return ratio(tracked, total); }

Repeatability measureRepeatability(const std::vector<std::optional<LineSegment>>& tracked,
                                   const std::vector<LineSegment>& others,
                                   const QualityOptions& options) {
  Repeatability result;
  result.total = tracked.size();
  for (const std::optional<LineSegment>& segment : tracked) {
    if (!segment) continue;
    ++result.tracked;
    const bool found = std::any_of(others.begin(), others.end(), [&](const LineSegment& other) {
      return sameSegment(*segment, other, options);
    });
    result.found += found ? 1 : 0;
  }
  return result;
}

void EdgeOffsets::add(const EdgeOffsets& other) {
  samples += other.samples;
  offsets_px.insert(offsets_px.end(), other.offsets_px.begin(), other.offsets_px.end());
}

double EdgeOffsets::rms_px() const {
  double sum = 0.0;
  for (const double offset : offsets_px) sum += offset * offset;
  return offsets_px.empty() ? 0.0 : std::sqrt(sum / static_cast<double>(offsets_px.size()));
}

double EdgeOffsets::median_px() const {
  std::vector<double> absolute;
  absolute.reserve(offsets_px.size());
  for (const double offset : offsets_px) absolute.push_back(std::abs(offset));
  return median(std::move(absolute));
}

double EdgeOffsets::edgeShare() const { return ratio(offsets_px.size(), samples); }

EdgeOffsets measureEdgeOffsets(const cv::Mat& smooth, const std::vector<LineSegment>& segments,
                               const QualityOptions& options) {
  EdgeOffsets result;
  for (const LineSegment& segment : segments) result.add(edgeOffsetsOf(smooth, segment, options));
  return result;
}

cv::Mat smoothForEdges(const cv::Mat& image) {
  cv::Mat smooth;
  image.convertTo(smooth, CV_32F);
  cv::GaussianBlur(smooth, smooth, cv::Size(0, 0), 1.0, 1.0, cv::BORDER_REPLICATE);
  return smooth;
}

std::vector<LineSegment> longSegments(std::vector<LineSegment> segments,
                                      const QualityOptions& options) {
  const auto is_short = [&](const LineSegment& s) { return s.length() <= options.min_length_px; };
  segments.erase(std::remove_if(segments.begin(), segments.end(), is_short), segments.end());
  std::stable_sort(
      segments.begin(), segments.end(),
      [](const LineSegment& a, const LineSegment& b) { return a.length() > b.length(); });
  return segments;
}

double totalLength_px(const std::vector<LineSegment>& segments) {
  double sum = 0.0;
  for (const LineSegment& segment : segments) sum += segment.length();
  return sum;
}

}  // namespace point_line_odometry
