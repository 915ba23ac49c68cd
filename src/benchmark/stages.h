#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "benchmark/inputs.h"
#include "common/thread_pool.h"
#include "features/line_feature_detector.h"
#include "features/point_detector.h"
#include "features/stereo_feature_detector.h"
#include "matching/expected_features.h"
#include "matching/frame_matcher.h"
#include "matching/stereo_frame.h"
#include "motion/correspondence.h"
#include "motion/motion_estimator.h"
#include "odometry/correspondences.h"
#include "odometry/stereo_triangulation.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_correction.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// The stages of the odometry as calls of their own on three consecutive frames from the middle of
/// an input's run, with the results of the stages before it. Each call repeats its stage for the
/// third frame and returns the number of its results.
class Stages {
 public:
  Stages(BenchmarkInput* input, const Parameters& parameters);

  /// The left image of the third frame.
  const cv::Mat& image() const { return images_.left; }

  std::size_t lines();
  std::size_t points();
  std::size_t detectStereo();
  std::size_t matchStereo();
  std::size_t triangulate();
  std::size_t matchCircular();
  std::size_t correspondences();
  std::size_t estimate();
  std::size_t fuse();

 private:
  StereoFrame makeFrame(const StereoImages& images, LineResolution resolution);
  MotionPrediction near(const Eigen::Isometry3d& T_curr_prev) const;
  Correspondences correspondencesOf(const StereoFrame& prev, const CircularMatches& matches,
                                    const Eigen::Isometry3d& T_curr_prev) const;

  const Parameters& parameters_;
  StereoCamera camera_;
  StereoCorrection correction_;
  StereoImages images_;
  LineFeatureDetector line_detector_;
  PointDetector point_detector_;
  StereoFeatureDetector stereo_detector_;
  LineResolution resolution_ = LineResolution::kFull;  // of the third frame
  ThreadPool threads_;
  ThreadPool one_thread_{1};

  // Of the third frame, from one stage to the next.
  StereoMatches stereo_matches_;
  StereoFrame curr_;
  CircularMatches circular_matches_;
  Correspondences correspondences_;
  MotionEstimate motion_;

  // The frames before.
  StereoFrame prev_;
  StereoFrame prev2_;
  Eigen::Isometry3d T_prev_prev2_;
};

}  // namespace point_line_odometry
