#pragma once

#include <string>
#include <utility>
#include <vector>

namespace point_line_odometry {

/// Points: FAST keypoints, bucketed in cells of the image, with orientation and binary descriptors.
struct PointParameters {
  /// Meaning, unit and range: visitParameters(). @{
  bool enabled = true;
  int cell_size_px = 50;
  int max_per_cell = 20;
  int levels = 7;
  double scale_factor = 1.4;
  int fast_threshold = 7;
  std::string descriptor = "brief";
  /// @}
};

/// Lines: straight edges, with LBD descriptors.
struct LineParameters {
  /// Meaning, unit and range: visitParameters(). @{
  bool enabled = true;
  std::string detector = "edge_chains";
  double min_length_px = 20.0;
  int max_count = 300;
  double min_gradient = 4.0;
  double max_deviation_px = 1.0;
  int coarse_to_fine_points = 600;
  /// @}
};

/// Circular matching over the four images of two stereo frames.
struct MatchingParameters {
  /// Meaning, unit and range: visitParameters(). @{
  double max_disparity_px = 200.0;
  double min_disparity_px = 1.0;
  double max_row_difference_px = 2.0;
  double search_radius_px = 25.0;
  double search_radius_without_velocity_px = 80.0;
  int max_point_distance = 60;
  int max_line_distance = 60;
  double max_distance_ratio = 0.9;
  double max_line_angle_deg = 10.0;
  double min_line_overlap = 0.5;
  double min_line_length_ratio = 0.5;
  bool refine_subpixel = true;
  bool keep_far_points = true;
  bool wide_search = true;
  /// @}
};

/// Triangulation and motion estimation by the point-line reprojection error.
struct MotionParameters {
  /// Meaning, unit and range: visitParameters(). @{
  std::string residual_images = "both";
  std::string fuse_rotation = "without_landmarks";
  double point_noise_px = 0.12;
  double line_noise_px = 0.08;
  double edge_noise_px = 0.45;
  bool adapt_noise = true;
  double min_line_angle_deg = 5.0;
  double huber_delta = 1.5;
  bool remove_outliers = true;
  double outlier_threshold = 3.0;
  bool solve_near_prediction = true;
  bool predict_weak_axes = true;
  int min_matches = 8;
  int min_inliers = 6;
  double min_inlier_ratio = 0.25;
  bool use_triangulation_covariance = true;
  /// @}
};

/// Bundle adjustment of keyframes and landmarks in a sliding window.
struct WindowParameters {
  /// Meaning, unit and range: visitParameters(). @{
  int size = 5;
  double keyframe_overlap = 0.6;
  int points_per_cell = 8;
  /// @}
};

/// Landmarks that are kept after they left the window.
struct LocalMapParameters {
  /// Meaning, unit and range: visitParameters(). @{
  int size = 100;
  double search_radius_px = 10.0;
  /// @}
};

/// What to do when frames are missing or their motion cannot be estimated.
struct TrackingParameters {
  /// Meaning, unit and range: visitParameters(). @{
  double max_frame_gap_s = 1.0;
  double max_prediction_s = 0.5;
  double max_prior_prediction_s = 10.0;
  double relocalization_s = 30.0;
  double max_speed_m_s = 60.0;
  double max_turn_rate_deg_s = 400.0;
  bool standstill_hold = true;
  bool refine_calibration = true;
  double rolling_shutter_ms = 0.0;
  double min_megapixels = 0.2;
  double max_megapixels = 1.0;
  int landmark_frames = 0;
  int threads = 2;
  /// @}
};

/// An inertial measurement unit: its gyroscope as a motion prior, gravity for roll and pitch.
struct ImuParameters {
  /// Meaning, unit and range: visitParameters(). @{
  bool enabled = false;
  double gyroscope_noise = 1.7e-4;
  double gyroscope_random_walk = 2.0e-5;
  double range_deg_s = 1000.0;
  double time_offset_s = 0.0;
  bool estimate_time_offset = true;
  bool use_gravity = true;
  double accelerometer_noise = 2.0e-3;
  double accelerometer_random_walk = 3.0e-3;
  /// @}
};

/// The odometry of wheels, or another source of poses, as a motion prior.
struct WheelParameters {
  /// Meaning, unit and range: visitParameters(). @{
  bool enabled = false;
  double slip_x = 0.05;
  double slip_y = 0.05;
  double slip_yaw = 0.05;
  double speed_noise = 0.05;
  double turn_noise = 0.05;
  /// @}
};

/// A robot on a flat floor, as a motion prior.
struct PlanarParameters {
  /// Meaning, unit and range: visitParameters(). @{
  bool enabled = false;
  double z_deviation = 0.02;
  double roll_deviation = 0.02;
  double pitch_deviation = 0.02;
  /// @}
};

/// All settings of the core.
struct Parameters {
  /// Names begin with that of the member. @{
  PointParameters points;
  LineParameters lines;
  MatchingParameters matching;
  MotionParameters motion;
  WindowParameters window;
  LocalMapParameters local_map;
  TrackingParameters tracking;
  ImuParameters imu;
  WheelParameters wheels;
  PlanarParameters planar;
  /// @}
};

/// The one table of the core's parameters. The loaders (YAML, ROS), the validator, the printed
/// table and doc/parameters.md come from it.
///
/// `visit` is called once per parameter, for numbers as `visit(name, value, minimum, maximum, unit,
/// text)`, for a bool as `visit(name, value, text)` and for a choice as `visit(name, value,
/// choices, text)`. Names are paths, as in YAML.
template <typename AnyParameters, typename Visitor>
// NOLINTNEXTLINE(readability-function-size): a table
void visitParameters(AnyParameters& p, Visitor&& visit) {
  visit("points/enabled", p.points.enabled, "use points");
  visit("points/cell_size_px", p.points.cell_size_px, 16, 400, "px",
        "side of the cells (buckets) of the image, each of which keeps its strongest points");
  visit("points/max_per_cell", p.points.max_per_cell, 1, 200, "",
        "most points kept in a cell; more cost time");
  visit("points/levels", p.points.levels, 1, 8, "",
        "pyramid levels in which points are detected, the coarser ones where the finer have few, "
        "and then lines in one of them, too");
  visit("points/scale_factor", p.points.scale_factor, 1.05, 2.0, "",
        "ratio of size between pyramid levels");
  visit("points/fast_threshold", p.points.fast_threshold, 1, 100, "grey levels",
        "smallest contrast of a point; a cell keeps its strongest ones");
  visit("points/descriptor", p.points.descriptor, std::vector<std::string>{"brief", "orb"},
        "pattern of the descriptor's comparisons: brief: random; orb: OpenCV's, trained");

  visit("lines/enabled", p.lines.enabled, "use line segments");
  visit("lines/detector", p.lines.detector,
        std::vector<std::string>{"edge_chains", "lsd", "lsd_or_edge_chains"},
        "edge_chains: this package's own; lsd: OpenCV's, which 4.1.0 to 4.5.3 do not have; "
        "lsd_or_edge_chains: lsd where OpenCV has it");
  visit("lines/min_length_px", p.lines.min_length_px, 8.0, 500.0, "px",
        "shorter segments are dropped");
  visit("lines/max_count", p.lines.max_count, 1, 5000, "",
        "most segments kept in an image, the longest first");
  visit("lines/min_gradient", p.lines.min_gradient, 1.0, 255.0, "grey levels / px",
        "smallest gradient of an edge; edge_chains only");
  visit("lines/max_deviation_px", p.lines.max_deviation_px, 0.2, 5.0, "px",
        "how far edge pixels may lie from their segment; edge_chains only");
  visit("lines/coarse_to_fine_points", p.lines.coarse_to_fine_points, 0, 100000, "",
        "after five frames with a motion, of which the last has at least this many stereo points, "
        "segments are found in the images at half their size and aligned in the full ones, which "
        "halves the time for lines; fewer short ones are found. 0: in all frames, 100000: in none; "
        "edge_chains only");

  visit("matching/max_disparity_px", p.matching.max_disparity_px, 1.0, 2000.0, "px",
        "largest disparity searched; sets the nearest depth");
  visit("matching/min_disparity_px", p.matching.min_disparity_px, 0.1, 100.0, "px",
        "smallest disparity from which a depth is triangulated, in pixels of the point's pyramid "
        "level; farther lines are dropped");
  visit("matching/max_row_difference_px", p.matching.max_row_difference_px, 0.5, 20.0, "px",
        "largest vertical disparity of a stereo match (delta_v), after the online calibration");
  visit("matching/search_radius_px", p.matching.search_radius_px, 1.0, 500.0, "px",
        "search radius around the position predicted from the velocity (delta_r)");
  visit("matching/search_radius_without_velocity_px", p.matching.search_radius_without_velocity_px,
        1.0, 1000.0, "px",
        "the same while no velocity is known, or if nothing is found within search_radius_px");
  visit("matching/max_point_distance", p.matching.max_point_distance, 0, 256, "bits",
        "largest descriptor distance of points");
  visit("matching/max_line_distance", p.matching.max_line_distance, 0, 256, "bits",
        "largest descriptor distance of lines");
  visit("matching/max_distance_ratio", p.matching.max_distance_ratio, 0.1, 1.0, "",
        "best descriptor distance over the second best, at most");
  visit("matching/max_line_angle_deg", p.matching.max_line_angle_deg, 0.5, 90.0, "deg",
        "largest difference of direction of matched lines");
  visit("matching/min_line_overlap", p.matching.min_line_overlap, 0.0, 1.0, "",
        "share of the shorter line that the longer must cover");
  visit("matching/min_line_length_ratio", p.matching.min_line_length_ratio, 0.0, 1.0, "",
        "length of the shorter line over that of the longer, at least");
  visit("matching/refine_subpixel", p.matching.refine_subpixel,
        "align the patches of matched points to sub-pixels");
  visit("matching/keep_far_points", p.matching.keep_far_points,
        "points with less than min_disparity_px constrain the rotation; false: dropped");
  visit("matching/wide_search", p.matching.wide_search,
        "where few matches are found near the prediction, match points over the whole image and "
        "predict with their RANSAC consensus; leave out the robot's own body");

  visit("motion/residual_images", p.motion.residual_images,
        std::vector<std::string>{"left", "both"},
        "images of frame k whose residuals are minimised; the paper: left");
  visit("motion/fuse_rotation", p.motion.fuse_rotation,
        std::vector<std::string>{"never", "without_landmarks", "always"},
        "fuse the rotation with an estimate over two frames (paper, eq. 9-10); without_landmarks: "
        "where window/size is 0, as it gains nothing with landmarks");
  visit("motion/point_noise_px", p.motion.point_noise_px, 0.01, 10.0, "px",
        "standard deviation of a point's pixel, in addition to that of its patch alignment");
  visit("motion/line_noise_px", p.motion.line_noise_px, 0.01, 10.0, "px",
        "standard deviation of a very long segment's end point along its normal");
  visit("motion/edge_noise_px", p.motion.edge_noise_px, 0.0, 10.0, "px",
        "standard deviation of an edge pixel; adds to the noise of short segments");
  visit("motion/adapt_noise", p.motion.adapt_noise,
        "estimate the scale of the noise of points and of lines from the residuals; with "
        "landmarks only");
  visit("motion/min_line_angle_deg", p.motion.min_line_angle_deg, 1.0, 60.0, "deg",
        "lines nearer to the epipolar direction are not triangulated");
  visit("motion/huber_delta", p.motion.huber_delta, 0.1, 100.0, "sigma",
        "whitened residuals whose norm is beyond it count linearly (paper, eq. 8)");
  visit("motion/remove_outliers", p.motion.remove_outliers,
        "solve again without the outliers; false: once with all matches (paper, eq. 7)");
  visit("motion/outlier_threshold", p.motion.outlier_threshold, 1.0, 100.0, "sigma",
        "matches are outliers whose whitened residual has a larger root mean square");
  visit("motion/solve_near_prediction", p.motion.solve_near_prediction,
        "where the motion of the majority of matches is implausible for a camera, solve with the "
        "matches near the prediction only");
  visit("motion/predict_weak_axes", p.motion.predict_weak_axes,
        "where the prediction constrains an axis of the motion better than the matches do, fuse "
        "the two by their covariances; the state is DEGRADED");
  visit("motion/min_matches", p.motion.min_matches, 3, 1000, "",
        "fewer triangulated matches give no motion");
  visit("motion/min_inliers", p.motion.min_inliers, 3, 1000, "", "fewer inliers give no motion");
  visit("motion/min_inlier_ratio", p.motion.min_inlier_ratio, 0.0, 1.0, "",
        "smaller share of inliers gives no motion");
  visit("motion/use_triangulation_covariance", p.motion.use_triangulation_covariance,
        "propagate the covariance of the triangulation to the residuals");

  visit("window/size", p.window.size, 0, 30, "keyframes",
        "poses of the bundle adjustment; 0: no landmarks, motion from frame to frame (the paper)");
  visit("window/keyframe_overlap", p.window.keyframe_overlap, 0.1, 0.95, "",
        "a frame that observes a smaller share of the last keyframe's landmarks is a keyframe");
  visit("window/points_per_cell", p.window.points_per_cell, 1, 50, "",
        "points that are tracked as landmarks in a cell of points/cell_size_px");
  visit("local_map/size", p.local_map.size, 0, 2000, "keyframes",
        "kept after they left the window, with their landmarks; 0: none");
  visit("local_map/search_radius_px", p.local_map.search_radius_px, 1.0, 200.0, "px",
        "search radius around the projection of a landmark that was missed in the last frame");

  visit(
      "tracking/max_frame_gap_s", p.tracking.max_frame_gap_s, 0.01, 60.0, "s",
      "after a longer time without a motion, one by the images alone is doubted (DEGRADED) unless "
      "landmarks confirm it; after a longer gap in the frames the pose is kept if there is none");
  visit("tracking/max_prediction_s", p.tracking.max_prediction_s, 0.0, 60.0, "s",
        "how long the motion is predicted from the velocity before the state is LOST");
  visit(
      "tracking/max_prior_prediction_s", p.tracking.max_prior_prediction_s, 0.0, 600.0, "s",
      "the same for frames with a motion prior that knows the rotation or the translation (after a "
      "gap in the frames: the translation); axes that it does not know "
      "follow the velocity");
  visit("tracking/relocalization_s", p.tracking.relocalization_s, 0.0, 3600.0, "s",
        "how long relocalization tries a map in which tracking was lost, once a new map was "
        "started; 0: only until then");
  visit("tracking/max_speed_m_s", p.tracking.max_speed_m_s, 0.01, 1000.0, "m/s",
        "faster estimates are rejected");
  visit("tracking/max_turn_rate_deg_s", p.tracking.max_turn_rate_deg_s, 1.0, 10000.0, "deg/s",
        "faster rotations are rejected");
  visit("tracking/standstill_hold", p.tracking.standstill_hold,
        "keep the published pose fixed while the estimated motion is within its noise");
  visit("tracking/refine_calibration", p.tracking.refine_calibration,
        "online stereo calibration: estimate and correct a smooth displacement of the right image, "
        "also of a camera that was knocked");
  visit(
      "tracking/rolling_shutter_ms", p.tracking.rolling_shutter_ms, -200.0, 200.0, "ms",
      "read-out time of a rolling shutter, from the first row of the raw image to the last one, as "
      "the doctor measures it; the stamp is that of the middle row; negative: the last row comes "
      "first; 0: a global shutter");
  visit(
      "tracking/min_megapixels", p.tracking.min_megapixels, 0.0, 1.0, "Mpx",
      "smaller images are processed at twice, three times, ... their size, which takes longer; 0: "
      "never");
  visit(
      "tracking/max_megapixels", p.tracking.max_megapixels, 0.05, 1000.0, "Mpx",
      "larger images are processed at a half, a third, ... of their size; all parameters in pixels "
      "are of that size");
  visit("tracking/landmark_frames", p.tracking.landmark_frames, 0, 10, "",
        "most frames in a row that are tracked by landmarks alone, where these leave no doubt, "
        "before features are detected again: such a frame takes a fifth of the time, but motions "
        "in a view that changes fast are less exact; 0: none, 1: every second one");
  visit("tracking/threads", p.tracking.threads, 1, 64, "",
        "threads that work on one frame; results do not depend on it");

  visit("imu/enabled", p.imu.enabled,
        "use the rotation by a gyroscope between frames as a motion prior; its bias is estimated");
  visit("imu/gyroscope_noise", p.imu.gyroscope_noise, 1e-6, 1.0, "rad/s/sqrt(Hz)",
        "noise density of the gyroscope, as Kalibr's gyroscope_noise_density");
  visit("imu/gyroscope_random_walk", p.imu.gyroscope_random_walk, 0.0, 1.0, "rad/s^2/sqrt(Hz)",
        "random walk of its bias, as Kalibr's gyroscope_random_walk");
  visit("imu/range_deg_s", p.imu.range_deg_s, 10.0, 100000.0, "deg/s",
        "largest rate that it measures: a sample at this limit is not used");
  visit("imu/time_offset_s", p.imu.time_offset_s, -0.05, 0.05, "s",
        "stamp of the IMU minus that of an image taken at the same time, as Kalibr's "
        "timeshift_cam_imu");
  visit("imu/estimate_time_offset", p.imu.estimate_time_offset,
        "estimate the time offset, too, within 0.05 s, beginning with the given one");
  visit("imu/use_gravity", p.imu.use_gravity,
        "with imu/enabled: keep roll and pitch from drifting by the accelerometer");
  visit("imu/accelerometer_noise", p.imu.accelerometer_noise, 1e-6, 10.0, "m/s^2/sqrt(Hz)",
        "noise density of the accelerometer, as Kalibr's accelerometer_noise_density");
  visit("imu/accelerometer_random_walk", p.imu.accelerometer_random_walk, 0.0, 10.0,
        "m/s^3/sqrt(Hz)", "random walk of its bias, as Kalibr's accelerometer_random_walk");

  visit("wheels/enabled", p.wheels.enabled,
        "use the motion between frames by wheels, or another odometry that does not use these "
        "images, as a motion prior");
  visit("wheels/slip_x", p.wheels.slip_x, 0.0, 10.0, "",
        "standard deviation of its motion along x of its body, as a share of the distance");
  visit("wheels/slip_y", p.wheels.slip_y, 0.0, 10.0, "",
        "the same along y, and along z where it is measured, as a share of the distance");
  visit("wheels/slip_yaw", p.wheels.slip_yaw, 0.0, 10.0, "",
        "standard deviation of its rotation, as a share of the angle");
  visit("wheels/speed_noise", p.wheels.speed_noise, 1e-5, 100.0, "m/s",
        "standard deviation of its speed along x and y, in addition, where the twist's covariance "
        "has none");
  visit("wheels/turn_noise", p.wheels.turn_noise, 1e-5, 100.0, "rad/s",
        "standard deviation of its turn rate about z, likewise");

  visit("planar/enabled", p.planar.enabled,
        "the robot moves on a flat floor: a motion prior that it does not move along its z, roll "
        "or pitch");
  visit("planar/z_deviation", p.planar.z_deviation, 1e-5, 100.0, "m/sqrt(s)",
        "standard deviation of its motion along z in a second; grows with the root of the time");
  visit("planar/roll_deviation", p.planar.roll_deviation, 1e-5, 100.0, "rad/sqrt(s)",
        "the same about x");
  visit("planar/pitch_deviation", p.planar.pitch_deviation, 1e-5, 100.0, "rad/sqrt(s)",
        "the same about y");
}

/// Detector of line segments, see lines/detector.
enum class LineDetectorKind { kNone, kEdgeChains, kLsd };

/// Lower-case name, as the parameter has it.
const char* toString(LineDetectorKind kind);

/// Name and value of every parameter, in the order of the table; the value as in a YAML file, with
/// all digits.
using ParameterTexts = std::vector<std::pair<std::string, std::string>>;
ParameterTexts parameterTexts(const Parameters& parameters);

/// Those whose values differ, with the values of `after`.
ParameterTexts changedParameters(const Parameters& before, const Parameters& after);

/// Whether any whose name begins so differs.
bool isChanged(const Parameters& before, const Parameters& after, const std::string& prefix);

/// One sentence for each parameter that is out of its range, not a finite number or not among its
/// choices; empty if all are fine.
std::vector<std::string> checkParameters(const Parameters& parameters);

/// The same parameters; throws std::invalid_argument with these sentences if there are any.
const Parameters& validated(const Parameters& parameters);

/// Sets the parameters that a YAML file names (the layout of config/*.yaml: nested maps of the
/// names' paths). Throws std::runtime_error with one sentence that names every unknown name, wrong
/// type and value out of range. \param ignored names outside the core's table that are legal in the
/// file, e.g. those of the ROS node. \param warnings gets a sentence for each name of an earlier
/// version that is ignored now; null: not wanted.
Parameters loadParameters(const std::string& yaml_file,
                          const std::vector<std::string>& ignored = {},
                          std::vector<std::string>* warnings = nullptr);

}  // namespace point_line_odometry
