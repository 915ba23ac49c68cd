#include "ros/frame_messages.h"

#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/image_encodings.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <tf2_eigen/tf2_eigen.h>

#include <algorithm>
#include <cmath>

#include "geometry/se3.h"
#include "point_line_odometry/feature_overlay.h"
#include "ros/conversions.h"

namespace point_line_odometry {
namespace {

std_msgs::ColorRGBA color(float r, float g, float b) {
  std_msgs::ColorRGBA c;
  c.r = r;
  c.g = g;
  c.b = b;
  c.a = 1.0F;
  return c;
}

/// An empty marker of separate segments.
visualization_msgs::Marker lineMarker(const std_msgs::Header& header, const std::string& name,
                                      double width_m, const std_msgs::ColorRGBA& color) {
  visualization_msgs::Marker marker;
  marker.header = header;
  marker.ns = name;
  marker.type = visualization_msgs::Marker::LINE_LIST;
  marker.action = visualization_msgs::Marker::ADD;
  marker.pose.orientation.w = 1.0;
  marker.scale.x = width_m;
  marker.color = color;
  return marker;
}

void append(const Eigen::Vector3d& start, const Eigen::Vector3d& end,
            visualization_msgs::Marker* marker) {
  marker->points.push_back(tf2::toMsg(start));
  marker->points.push_back(tf2::toMsg(end));
}

template <typename Segment>
void setPixels(const Segment& segment, boost::array<float, 4>* pixels) {
  *pixels = {{segment.start.x(), segment.start.y(), segment.end.x(), segment.end.y()}};
}

/// An isometry in the precision of the features.
Eigen::Isometry3f toFloat(const Eigen::Isometry3d& T) { return T.cast<float>(); }

float intensityAt(const cv::Mat& image, const Eigen::Vector2f& pixel) {
  const int u = static_cast<int>(std::lround(pixel.x()));
  const int v = static_cast<int>(std::lround(pixel.y()));
  if (u < 0 || v < 0 || u >= image.cols || v >= image.rows) return 0.0F;
  return static_cast<float>(image.at<std::uint8_t>(v, u));
}

void setCounts(const FrameCounts& counts, OdometryInfo* info) {
  const auto count = [](int value) { return static_cast<std::uint32_t>(std::max(0, value)); };
  info->points_left = count(counts.points_left);
  info->points_right = count(counts.points_right);
  info->lines_left = count(counts.lines_left);
  info->lines_right = count(counts.lines_right);
  info->point_stereo_matches = count(counts.point_stereo_matches);
  info->line_stereo_matches = count(counts.line_stereo_matches);
  info->point_matches = count(counts.point_matches);
  info->line_matches = count(counts.line_matches);
  info->lines_not_triangulable = count(counts.lines_not_triangulable);
  info->point_inliers = count(counts.point_inliers);
  info->line_inliers = count(counts.line_inliers);
  info->iterations = count(counts.iterations);
}

std::uint8_t toInfoState(TrackingState state) {
  switch (state) {
    case TrackingState::kInitializing:
      return OdometryInfo::INITIALIZING;
    case TrackingState::kOk:
      return OdometryInfo::OK;
    case TrackingState::kDegraded:
      return OdometryInfo::DEGRADED;
    case TrackingState::kLost:
      break;
  }
  return OdometryInfo::LOST;
}

}  // namespace

nav_msgs::Odometry toOdometry(const ProcessedFrame& frame, const FrameNames& names) {
  const FrameResult& result = frame.result;
  const Matrix6d base_from_camera = adjoint(frame.T_base_camera);
  const Vector6d twist = base_from_camera * result.twist;

  nav_msgs::Odometry odometry;
  odometry.header.stamp = frame.header.stamp;
  odometry.header.frame_id = names.odom;
  odometry.child_frame_id = names.base;
  odometry.pose.pose = toPose(frame.T_odom_base());
  odometry.pose.covariance =
      toCovariance(composeCovariance(result.T_odom_camera, result.pose_covariance,
                                     frame.T_base_camera.inverse(), Matrix6d::Zero()));
  odometry.twist.twist = tf2::toMsg(twist);
  odometry.twist.covariance =
      toCovariance(base_from_camera * result.twist_covariance * base_from_camera.transpose());
  return odometry;
}

geometry_msgs::TransformStamped toTransformStamped(const ProcessedFrame& frame,
                                                   const FrameNames& names, bool invert,
                                                   const Eigen::Isometry3d& T_child_base) {
  const Eigen::Isometry3d T_odom_child = frame.T_odom_base() * T_child_base.inverse();
  geometry_msgs::TransformStamped transform;
  transform.header.stamp = frame.header.stamp;
  transform.header.frame_id = invert ? names.base : names.odom;
  transform.child_frame_id = invert ? names.odom : names.base;
  transform.transform = toTransform(invert ? T_odom_child.inverse() : T_odom_child);
  return transform;
}

sensor_msgs::PointCloud2 toPointCloud(const ProcessedFrame& frame) {
  const auto& points = frame.result.points;
  const auto inliers = std::count_if(points.begin(), points.end(),
                                     [](const ObservedPoint& point) { return point.inlier; });
  sensor_msgs::PointCloud2 cloud;
  cloud.header = frame.header;
  cloud.is_dense = true;
  sensor_msgs::PointCloud2Modifier modifier(cloud);
  modifier.setPointCloud2Fields(
      4, "x", 1, sensor_msgs::PointField::FLOAT32, "y", 1, sensor_msgs::PointField::FLOAT32, "z", 1,
      sensor_msgs::PointField::FLOAT32, "intensity", 1, sensor_msgs::PointField::FLOAT32);
  modifier.resize(static_cast<std::size_t>(inliers));
  sensor_msgs::PointCloud2Iterator<float> x(cloud, "x");
  const Eigen::Isometry3f T_header_camera = toFloat(frame.T_header_camera);
  for (const ObservedPoint& point : points) {
    if (!point.inlier) continue;
    const Eigen::Vector3f p = T_header_camera * point.p_camera;
    x[0] = p.x();
    x[1] = p.y();
    x[2] = p.z();
    x[3] = intensityAt(frame.left, point.left_px);
    ++x;
  }
  return cloud;
}

visualization_msgs::MarkerArray toLineMarkers(const ProcessedFrame& frame) {
  constexpr double kWidthM = 0.03;
  auto inliers = lineMarker(frame.header, "inliers", kWidthM, color(0.1F, 0.9F, 0.2F));
  auto outliers = lineMarker(frame.header, "outliers", kWidthM, color(0.9F, 0.1F, 0.1F));
  for (const ObservedLine& line : frame.result.lines) {
    append(frame.T_header_camera * line.start_camera.cast<double>(),
           frame.T_header_camera * line.end_camera.cast<double>(),
           line.inlier ? &inliers : &outliers);
  }
  visualization_msgs::MarkerArray markers;
  markers.markers = {inliers, outliers};
  for (visualization_msgs::Marker& marker : markers.markers) {
    if (marker.points.empty()) marker.action = visualization_msgs::Marker::DELETE;
  }
  return markers;
}

visualization_msgs::Marker toAccumulatedMarker(const std::deque<AccumulatedSegment>& segments,
                                               const std_msgs::Header& header) {
  constexpr double kWidthM = 0.015;
  auto marker = lineMarker(header, "landmarks", kWidthM, color(0.3F, 0.55F, 1.0F));
  for (const AccumulatedSegment& segment : segments) append(segment.start, segment.end, &marker);
  return marker;
}

visualization_msgs::Marker deleteAllMarkers(const std_msgs::Header& header) {
  visualization_msgs::Marker marker;
  marker.header = header;
  marker.pose.orientation.w = 1.0;
  marker.action = visualization_msgs::Marker::DELETEALL;
  return marker;
}

std::vector<AccumulatedSegment> toAccumulatedSegments(const ProcessedFrame& frame) {
  constexpr double kMaxDepthInBaselines = 50.0;
  const auto max_depth_m = static_cast<float>(kMaxDepthInBaselines * frame.camera.baseline_m);
  std::vector<AccumulatedSegment> landmarks;
  for (const ObservedLine& line : frame.result.lines) {
    const float depth_m = std::max(line.start_camera.z(), line.end_camera.z());
    if (!line.inlier || depth_m > max_depth_m) continue;
    landmarks.push_back({frame.result.T_odom_camera * line.start_camera.cast<double>(),
                         frame.result.T_odom_camera * line.end_camera.cast<double>()});
  }
  return landmarks;
}

StereoFeatures toFeatures(const ProcessedFrame& frame) {
  const Eigen::Isometry3f T_header_camera = toFloat(frame.T_header_camera);
  StereoFeatures features;
  features.header = frame.header;
  features.points.reserve(frame.result.points.size());
  for (const ObservedPoint& observed : frame.result.points) {
    MatchedPoint point;
    point.left_u = observed.left_px.x();
    point.left_v = observed.left_px.y();
    point.right_u = observed.right_px.x();
    point.right_v = observed.right_px.y();
    point.point = toPoint32(T_header_camera * observed.p_camera);
    point.inlier = observed.inlier;
    features.points.push_back(point);
  }
  features.lines.reserve(frame.result.lines.size());
  for (const ObservedLine& observed : frame.result.lines) {
    MatchedLine line;
    setPixels(observed.left_px, &line.left);
    setPixels(observed.right_px, &line.right);
    line.start = toPoint32(T_header_camera * observed.start_camera);
    line.end = toPoint32(T_header_camera * observed.end_camera);
    line.inlier = observed.inlier;
    features.lines.push_back(line);
  }
  return features;
}

OdometryInfo toInfo(const ProcessedFrame& frame, const FrameCounters& counters, double latency_ms) {
  const FrameResult& result = frame.result;
  OdometryInfo info;
  info.header = frame.header;
  info.state = toInfoState(result.state);
  if (result.reason != TrackingReason::kNone) info.reason = toString(result.reason);
  setCounts(result.counts, &info);
  info.rms_px = std::isfinite(result.rms_px) ? result.rms_px : 0.0;
  info.prior = toString(result.prior.use);
  info.prior_chi_square = std::isfinite(result.prior.chi_square) ? result.prior.chi_square : 0.0;
  info.prior_axes = static_cast<std::uint32_t>(result.prior.axes);
  for (int i = 0; i < kNumStages; ++i) {
    const auto stage = static_cast<Stage>(i);
    info.stage_names.emplace_back(toString(stage));
    info.stage_ms.push_back(result.times[stage]);
  }
  info.total_ms = result.times.total_ms;
  info.feature_budget = frame.feature_budget;
  info.latency_ms = latency_ms;
  info.frames_processed = counters.processed;
  info.frames_dropped = counters.dropped;
  info.frames_rejected = counters.rejected;
  info.exceptions = counters.exceptions;
  info.stamps_rejected = counters.stamps_rejected;
  info.relocalizations = counters.relocalizations;
  return info;
}

sensor_msgs::ImagePtr toFeaturesImage(const ProcessedFrame& frame) {
  const cv::Mat image = drawFeatures(frame.left, frame.result, frame.left_mask);
  return cv_bridge::CvImage(frame.header, sensor_msgs::image_encodings::BGR8, image).toImageMsg();
}

double latencyMs(const ros::Time& stamp, const ros::Time& now) {
  constexpr double kLongestS = 60.0;
  // A difference of ros::Times that is too long for a ros::Duration throws.
  const double latency_s = now.toSec() - stamp.toSec();
  return latency_s >= 0.0 && latency_s <= kLongestS ? 1e3 * latency_s : 0.0;
}

}  // namespace point_line_odometry
