#pragma once

#include <string>
#include <utility>
#include <vector>

namespace point_line_odometry {

/// Points: FAST corners, spread over the image by cells, with orientation and binary descriptors.
struct PointParameters {
  bool enabled = true;
  int cell_size_px = 50;
  int max_per_cell = 20;
  int levels = 7;
  double scale_factor = 1.4;
  int fast_threshold = 7;
  std::string descriptor = "brief";
};

/// Lines: straight edges, with LBD descriptors.
struct LineParameters {
  bool enabled = true;
  std::string detector = "edge_chains";
  double min_length_px = 20.0;
  int max_count = 300;
  double min_gradient = 4.0;
  double max_deviation_px = 1.0;
};

/// Circular matching over the four images of two stereo frames.
struct MatchingParameters {
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
};

/// Triangulation, the point-line reprojection model and its solution.
struct MotionParameters {
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
  int max_iterations = 20;
  int min_matches = 8;
  int min_inliers = 6;
  double min_inlier_ratio = 0.25;
  bool use_triangulation_covariance = true;
};

/// Landmarks and keyframes that are adjusted together.
struct WindowParameters {
  int size = 5;
  double keyframe_overlap = 0.6;
  int points_per_cell = 8;
  int max_iterations = 5;
};

/// Landmarks that are kept after they left the window.
struct LocalMapParameters {
  int size = 100;
  double search_radius_px = 10.0;
};

/// What to do when frames are missing or give no motion.
struct TrackingParameters {
  double max_frame_gap_s = 1.0;
  double max_prediction_s = 0.5;
  double relocalization_s = 30.0;
  double max_speed_m_s = 60.0;
  double max_turn_rate_deg_s = 400.0;
  bool standstill_hold = true;
  bool refine_calibration = true;
  double max_megapixels = 1.0;
  int threads = 2;
};

/// All settings of the core.
struct Parameters {
  PointParameters points;
  LineParameters lines;
  MatchingParameters matching;
  MotionParameters motion;
  WindowParameters window;
  LocalMapParameters local_map;
  TrackingParameters tracking;
};

/// The one table of the core's parameters. The loaders (YAML, ROS), the validator, the printed
/// table and README come from it.
///
/// `visit` is called once per parameter, for numbers as `visit(name, value, minimum, maximum, unit,
/// text)`, for a bool as `visit(name, value, text)` and for a choice as `visit(name, value,
/// choices, text)`. Names are paths, as in YAML.
template <typename AnyParameters, typename Visitor>
// NOLINTNEXTLINE(readability-function-size): a table
void visitParameters(AnyParameters& p, Visitor&& visit) {
  visit("points/enabled", p.points.enabled, "use points");
  visit("points/cell_size_px", p.points.cell_size_px, 16, 400, "px",
        "side of the cells over which points are spread");
  visit("points/max_per_cell", p.points.max_per_cell, 1, 200, "",
        "most points kept in a cell; more cost time");
  visit(
      "points/levels", p.points.levels, 1, 8, "",
      "pyramid levels in which corners are looked for, the coarser ones where the finer have few");
  visit("points/scale_factor", p.points.scale_factor, 1.05, 2.0, "",
        "ratio of size between pyramid levels");
  visit("points/fast_threshold", p.points.fast_threshold, 1, 100, "grey levels",
        "weakest contrast of a corner; a cell takes it only when it has no stronger ones");
  visit("points/descriptor", p.points.descriptor, std::vector<std::string>{"brief", "orb"},
        "pattern of the descriptor's comparisons: brief: drawn at random; orb: learnt, OpenCV's");

  visit("lines/enabled", p.lines.enabled, "use line segments");
  visit("lines/detector", p.lines.detector,
        std::vector<std::string>{"edge_chains", "lsd", "lsd_or_edge_chains"},
        "edge_chains: this package's own; lsd: OpenCV's, which OpenCV 4.1.0 to 4.5.3 have not; "
        "lsd_or_edge_chains: lsd where OpenCV has it");
  visit("lines/min_length_px", p.lines.min_length_px, 8.0, 500.0, "px",
        "shorter segments are dropped");
  visit("lines/max_count", p.lines.max_count, 1, 5000, "",
        "most segments kept in an image, the longest first");
  visit("lines/min_gradient", p.lines.min_gradient, 1.0, 255.0, "grey levels / px",
        "weakest gradient of an edge; edge_chains only");
  visit("lines/max_deviation_px", p.lines.max_deviation_px, 0.2, 5.0, "px",
        "how far edge pixels may lie from their segment; edge_chains only");

  visit("matching/max_disparity_px", p.matching.max_disparity_px, 1.0, 2000.0, "px",
        "largest disparity looked for; sets the nearest depth");
  visit("matching/min_disparity_px", p.matching.min_disparity_px, 0.1, 100.0, "px",
        "smallest disparity that tells a distance; farther lines are dropped");
  visit("matching/max_row_difference_px", p.matching.max_row_difference_px, 0.5, 20.0, "px",
        "how far rows of left and right may differ (delta_v)");
  visit("matching/search_radius_px", p.matching.search_radius_px, 1.0, 500.0, "px",
        "search round the place predicted from the velocity (delta_r)");
  visit("matching/search_radius_without_velocity_px", p.matching.search_radius_without_velocity_px,
        1.0, 1000.0, "px", "the same while no velocity is known");
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
        "align matched points on the image to sub-pixels");
  visit("matching/keep_far_points", p.matching.keep_far_points,
        "points nearer to infinity than min_disparity_px tell the rotation; false: dropped");
  visit("matching/wide_search", p.matching.wide_search,
        "where little is found near the prediction, match points over the whole image and take "
        "the motion on which most of them agree as the prediction");

  visit("motion/residual_images", p.motion.residual_images,
        std::vector<std::string>{"left", "both"},
        "images of frame k whose residuals are minimised; the paper: left");
  visit("motion/fuse_rotation", p.motion.fuse_rotation,
        std::vector<std::string>{"never", "without_landmarks", "always"},
        "fuse the rotation with an estimate over two frames (paper, eq. 9-10); without_landmarks: "
        "where window/size is 0, as it gains nothing beside landmarks");
  visit("motion/point_noise_px", p.motion.point_noise_px, 0.01, 10.0, "px",
        "standard deviation of a point's pixel beyond what its patch shows");
  visit("motion/line_noise_px", p.motion.line_noise_px, 0.01, 10.0, "px",
        "standard deviation of a very long segment's end point across the line");
  visit("motion/edge_noise_px", p.motion.edge_noise_px, 0.0, 10.0, "px",
        "standard deviation of an edge pixel; adds to the noise of short segments");
  visit("motion/adapt_noise", p.motion.adapt_noise,
        "scale the noise of points and that of lines by what the residuals show; with landmarks "
        "only");
  visit("motion/min_line_angle_deg", p.motion.min_line_angle_deg, 1.0, 60.0, "deg",
        "lines nearer to the epipolar direction are not triangulated");
  visit("motion/huber_delta", p.motion.huber_delta, 0.1, 100.0, "sigma",
        "residuals beyond it count linearly (paper, eq. 8)");
  visit("motion/remove_outliers", p.motion.remove_outliers,
        "solve a second time without the outliers; false: once with all matches (paper, eq. 7)");
  visit("motion/outlier_threshold", p.motion.outlier_threshold, 1.0, 100.0, "sigma",
        "matches with a larger residual are outliers");
  visit("motion/solve_near_prediction", p.motion.solve_near_prediction,
        "where a camera can hardly have made the motion on which most matches agree, solve with "
        "those near the prediction alone");
  visit("motion/predict_weak_axes", p.motion.predict_weak_axes,
        "where the prediction knows the motion along an axis better than what is seen, combine the "
        "two by their covariances; the state is DEGRADED");
  visit("motion/max_iterations", p.motion.max_iterations, 1, 200, "",
        "Levenberg-Marquardt steps of a solution");
  visit("motion/min_matches", p.motion.min_matches, 3, 1000, "",
        "fewer triangulated matches give no motion");
  visit("motion/min_inliers", p.motion.min_inliers, 3, 1000, "", "fewer inliers give no motion");
  visit("motion/min_inlier_ratio", p.motion.min_inlier_ratio, 0.0, 1.0, "",
        "smaller share of inliers gives no motion");
  visit("motion/use_triangulation_covariance", p.motion.use_triangulation_covariance,
        "carry the noise of the triangulation into the weights");

  visit("window/size", p.window.size, 0, 30, "keyframes",
        "poses that are adjusted together with their landmarks; 0: no landmarks, motion from frame "
        "to frame (the paper)");
  visit("window/keyframe_overlap", p.window.keyframe_overlap, 0.1, 0.95, "",
        "a frame that sees a smaller share of the last keyframe's landmarks is the next keyframe");
  visit("window/points_per_cell", p.window.points_per_cell, 1, 50, "",
        "points that are tracked as landmarks in a cell of points/cell_size_px");
  visit("window/max_iterations", p.window.max_iterations, 1, 50, "",
        "Levenberg-Marquardt steps for a window");
  visit("local_map/size", p.local_map.size, 0, 2000, "keyframes",
        "kept after they left the window, with their landmarks; 0: none");
  visit("local_map/search_radius_px", p.local_map.search_radius_px, 1.0, 200.0, "px",
        "search round the projection of a landmark that was not seen in the last frame");

  visit("tracking/max_frame_gap_s", p.tracking.max_frame_gap_s, 0.01, 60.0, "s",
        "after a longer gap the pose is kept, unless the camera is found in the map");
  visit("tracking/max_prediction_s", p.tracking.max_prediction_s, 0.0, 60.0, "s",
        "how long the velocity is kept without a measurement before the state is LOST");
  visit("tracking/relocalization_s", p.tracking.relocalization_s, 0.0, 3600.0, "s",
        "how long the camera is looked for in the map of before, once its way from there is lost; "
        "0: only while there is no other map");
  visit("tracking/max_speed_m_s", p.tracking.max_speed_m_s, 0.01, 1000.0, "m/s",
        "faster estimates are rejected");
  visit("tracking/max_turn_rate_deg_s", p.tracking.max_turn_rate_deg_s, 1.0, 10000.0, "deg/s",
        "faster rotations are rejected");
  visit("tracking/standstill_hold", p.tracking.standstill_hold,
        "keep the published pose exactly still while all measured motion is within its noise");
  visit("tracking/refine_calibration", p.tracking.refine_calibration,
        "estimate and correct a small smooth displacement of the right image against its "
        "calibration");
  visit(
      "tracking/max_megapixels", p.tracking.max_megapixels, 0.05, 1000.0, "Mpx",
      "larger images are processed at a half, a third, ... of their size; all parameters in pixels "
      "are of that size");
  visit("tracking/threads", p.tracking.threads, 1, 64, "",
        "threads that work on one frame; results do not depend on it");
}

/// Name and value of every parameter, in the order of the table; the value as in a YAML file, with
/// all digits.
using ParameterTexts = std::vector<std::pair<std::string, std::string>>;
ParameterTexts parameterTexts(const Parameters& parameters);

/// Those whose values differ, with the values of `after`.
ParameterTexts changedParameters(const Parameters& before, const Parameters& after);

/// One sentence for each parameter that is out of its range, not a finite number or not among its
/// choices; empty if all are fine.
std::vector<std::string> checkParameters(const Parameters& parameters);

/// Sets the parameters that a YAML file names (the layout of config/*.yaml: nested maps of the
/// names' paths). Throws std::runtime_error with one sentence that names every unknown name, wrong
/// type and value out of range. \param ignored names outside the core's table that are legal in the
/// file, e.g. those of the ROS node.
Parameters loadParameters(const std::string& yaml_file,
                          const std::vector<std::string>& ignored = {});

}  // namespace point_line_odometry
