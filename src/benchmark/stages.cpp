#include "benchmark/stages.h"

#include <utility>

namespace point_line_odometry {

Stages::Stages(BenchmarkInput* input, const Parameters& parameters)
    : parameters_(parameters),
      camera_(input->camera()),
      correction_(camera_),
      line_detector_(parameters.lines, lineDetectorKind(parameters.lines)),
      point_detector_(parameters.points),
      stereo_detector_(parameters.points, parameters.lines),
      threads_(parameters.tracking.threads) {
  const std::vector<StereoImages>& run = input->run();
  const std::size_t middle = run.size() / 2;
  prev2_ = makeFrame(run[middle - 2], lineResolutionAfter(0, parameters_.lines));
  prev_ = makeFrame(run[middle - 1], lineResolutionAfter(prev2_.points.size(), parameters_.lines));
  images_ = run[middle];
  resolution_ = lineResolutionAfter(prev_.points.size(), parameters_.lines);
  curr_ = makeFrame(images_, resolution_);
  matchStereo();

  const MotionPrediction unknown{Eigen::Isometry3d::Identity(),
                                 parameters_.matching.search_radius_without_velocity_px};
  const CircularMatches matches =
      ::point_line_odometry::matchCircular(prev2_, prev_, camera_, unknown, parameters_.matching);
  const FrameContext before{run[middle - 1], camera_, correction_, parameters_};
  T_prev_prev2_ = estimateMotion(makeCorrespondences(prev2_, prev_, matches, unknown.T_curr_prev,
                                                     before, nullptr),
                                 camera_, unknown.T_curr_prev, parameters_.motion)
                      .T_curr_prev;
  matchCircular();
  correspondences();
  estimate();
}

StereoFrame Stages::makeFrame(const StereoImages& images, LineResolution resolution) {
  StereoFrame frame;
  frame.stamp_ns = images.stamp_ns;
  frame.left_image = ImagePyramid(images.left);
  frame.features = stereo_detector_.detect(images, resolution, &threads_);
  const StereoMatches matches = ::point_line_odometry::matchStereo(frame.features, correction_,
                                                                   parameters_.matching, &threads_);
  triangulateMatches(matches, {images, camera_, correction_, parameters_}, &threads_, &frame);
  return frame;
}

MotionPrediction Stages::near(const Eigen::Isometry3d& T_curr_prev) const {
  return {T_curr_prev, parameters_.matching.search_radius_px};
}

Correspondences Stages::correspondencesOf(const StereoFrame& prev, const CircularMatches& matches,
                                          const Eigen::Isometry3d& T_curr_prev) const {
  return makeCorrespondences(prev, curr_, matches, T_curr_prev,
                             {images_, camera_, correction_, parameters_}, nullptr);
}

std::size_t Stages::lines() { return line_detector_.detect(images_.left, resolution_).size(); }

std::size_t Stages::points() { return point_detector_.detect(images_.left).size(); }

std::size_t Stages::detectStereo() {
  const DetectedFeatures features = stereo_detector_.detect(images_, resolution_, &threads_);
  return features.points_left.size() + features.points_right.size() + features.lines_left.size() +
         features.lines_right.size();
}

std::size_t Stages::matchStereo() {
  stereo_matches_ = ::point_line_odometry::matchStereo(curr_.features, correction_,
                                                       parameters_.matching, &one_thread_);
  return stereo_matches_.points.size() + stereo_matches_.lines.size();
}

std::size_t Stages::triangulate() {
  curr_.points.clear();
  curr_.lines.clear();
  triangulateMatches(stereo_matches_, {images_, camera_, correction_, parameters_}, &one_thread_,
                     &curr_);
  return curr_.points.size() + curr_.lines.size();
}

std::size_t Stages::matchCircular() {
  circular_matches_ = ::point_line_odometry::matchCircular(
      prev_, curr_, camera_, near(T_prev_prev2_), parameters_.matching);
  return circular_matches_.points.size() + circular_matches_.lines.size();
}

std::size_t Stages::correspondences() {
  correspondences_ = correspondencesOf(prev_, circular_matches_, T_prev_prev2_);
  return correspondences_.points.size() + correspondences_.lines.size();
}

std::size_t Stages::estimate() {
  motion_ = estimateMotion(correspondences_, camera_, T_prev_prev2_, parameters_.motion);
  return static_cast<std::size_t>(motion_.numInliers());
}

std::size_t Stages::fuse() {
  const Eigen::Isometry3d expected = motion_.T_curr_prev * T_prev_prev2_;
  const CircularMatches matches = ::point_line_odometry::matchCircular(
      prev2_, curr_, camera_, near(expected), parameters_.matching);
  const MotionEstimate over_two = estimateMotion(correspondencesOf(prev2_, matches, expected),
                                                 camera_, expected, parameters_.motion);
  if (!over_two.ok()) return 0;
  const MotionEstimate fused = fuseRotation(motion_, {over_two.T_curr_prev, T_prev_prev2_},
                                            correspondences_, camera_, parameters_.motion);
  return static_cast<std::size_t>(fused.numInliers());
}

}  // namespace point_line_odometry
