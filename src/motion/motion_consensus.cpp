#include "motion/motion_consensus.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <random>

#include "motion/motion_cost.h"

namespace point_line_odometry {
namespace {

constexpr double kMaxErrorPx = 3.0;  // of an inlier, in each coordinate: keypoints are not aligned
constexpr int kMaxSamples = 1000;
constexpr double kConfidence = 0.999;  // that one of the samples is free of outliers
constexpr int kSampleSize = 3;

using Sample = std::array<int, kSampleSize>;

/// Three different indices below `size`.
Sample drawSample(std::mt19937* generator, int size) {
  Sample sample{};
  for (int i = 0; i < kSampleSize; ++i) {
    const auto begin = sample.begin();
    do {
      sample[i] = static_cast<int>((*generator)() % static_cast<unsigned>(size));
    } while (std::find(begin, begin + i, sample[i]) != begin + i);
  }
  return sample;
}

/// The solutions of P3P, at most four.
std::vector<Eigen::Isometry3d> solveThree(const std::vector<PointCorrespondence>& matches,
                                          const StereoCamera& camera, const Sample& sample) {
  std::vector<cv::Point3d> points;
  std::vector<cv::Point2d> rays;
  for (const int i : sample) {
    const PointCorrespondence& match = matches[static_cast<std::size_t>(i)];
    points.emplace_back(match.p_prev.x(), match.p_prev.y(), match.p_prev.z());
    rays.emplace_back((match.left_px.x() - camera.cx) / camera.fx,
                      (match.left_px.y() - camera.cy) / camera.fy);
  }
  std::vector<cv::Mat> rotations;
  std::vector<cv::Mat> translations;
  cv::solveP3P(points, rays, cv::Matx33d::eye(), cv::noArray(), rotations, translations,
               cv::SOLVEPNP_AP3P);
  std::vector<Eigen::Isometry3d> motions;
  for (std::size_t i = 0; i < rotations.size(); ++i) {
    MotionVector motion;
    cv::cv2eigen(rotations[i], motion.rotation);
    cv::cv2eigen(translations[i], motion.translation);
    if (motion.rotation.allFinite() && motion.translation.allFinite())
      motions.push_back(motion.toIsometry());
  }
  return motions;
}

bool agrees(const PointCorrespondence& match, const StereoCamera& camera,
            const Eigen::Isometry3d& T_curr_prev) {
  const Eigen::Vector3d p = T_curr_prev * match.p_prev;
  if (!(p.z() > 0.1 * camera.baseline_m)) return false;
  const Eigen::Array2d error_px = camera.projectLeft(p) - match.left_px;
  const double max_error_px = kMaxErrorPx * match.sigma_px;
  return (error_px.abs() <= max_error_px).all() &&  // false for NaN
         std::abs(camera.projectRight(p).x() - match.right_px.x()) <= max_error_px;
}

/// Number of samples of which one is free of outliers with probability kConfidence.
double samplesNeeded(int inliers, int size) {
  const double all_inliers = std::pow(static_cast<double>(inliers) / size, kSampleSize);
  return std::log(1.0 - kConfidence) / std::log1p(-std::min(all_inliers, 1.0 - 1e-12));
}

}  // namespace

std::optional<MotionConsensus> findConsensus(const std::vector<PointCorrespondence>& matches,
                                             const StereoCamera& camera) {
  const int size = static_cast<int>(matches.size());
  if (size < kMinConsensus) return std::nullopt;
  MotionConsensus best;
  std::mt19937 generator(20170607U);
  double needed = kMaxSamples;
  for (int sample = 0; sample < needed; ++sample) {
    for (const Eigen::Isometry3d& T : solveThree(matches, camera, drawSample(&generator, size))) {
      const auto inliers =
          static_cast<int>(std::count_if(matches.begin(), matches.end(), [&](const auto& match) {
            return agrees(match, camera, T);
          }));
      if (inliers <= best.num_inliers) continue;
      best.num_inliers = inliers;
      best.T_curr_prev = T;
      needed = std::min<double>(kMaxSamples, samplesNeeded(inliers, size));
    }
  }
  if (best.num_inliers < kMinConsensus) return std::nullopt;
  best.inliers.reserve(matches.size());
  for (const PointCorrespondence& match : matches)
    best.inliers.push_back(agrees(match, camera, best.T_curr_prev));
  return best;
}

}  // namespace point_line_odometry
