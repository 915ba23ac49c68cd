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
constexpr double kUnexplained = 2.0;   // beyond so many errors of an inlier
constexpr double kLeastSine = 0.02;    // of the angle between two rays that give a rotation

template <std::size_t kSize>
using MinimalSample = std::array<int, kSize>;

/// Different indices below `size`.
template <std::size_t kSize>
MinimalSample<kSize> drawSample(std::mt19937* generator, int size) {
  MinimalSample<kSize> sample{};
  for (std::size_t i = 0; i < kSize; ++i) {
    const auto end = sample.begin() + static_cast<std::ptrdiff_t>(i);
    do {
      sample[i] = static_cast<int>((*generator)() % static_cast<unsigned>(size));
    } while (std::find(sample.begin(), end, sample[i]) != end);
  }
  return sample;
}

/// The solutions of P3P, at most four.
std::vector<Eigen::Isometry3d> solveThree(const std::vector<PointCorrespondence>& matches,
                                          const StereoCamera& camera,
                                          const MinimalSample<3>& sample) {
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

Eigen::Vector3d rayOf(const Eigen::Vector2d& pixel, const StereoCamera& camera) {
  return {(pixel.x() - camera.cx) / camera.fx, (pixel.y() - camera.cy) / camera.fy, 1.0};
}

/// Axes of two rays: their middle, their normal, and the axis across.
std::optional<Eigen::Matrix3d> axesOf(const Eigen::Vector3d& first, const Eigen::Vector3d& second) {
  const Eigen::Vector3d a = first.normalized();
  const Eigen::Vector3d b = second.normalized();
  const Eigen::Vector3d normal = a.cross(b);
  if (!(normal.norm() >= kLeastSine)) return std::nullopt;
  Eigen::Matrix3d axes;
  axes.col(0) = (a + b).normalized();
  axes.col(1) = normal.normalized();
  axes.col(2) = axes.col(0).cross(axes.col(1));
  return axes;
}

/// The motion that turns two far points onto their pixels; none if they are close to each other.
std::vector<Eigen::Isometry3d> solveTwo(const std::vector<PointCorrespondence>& matches,
                                        const StereoCamera& camera,
                                        const Eigen::Vector3d& position_prev,
                                        const MinimalSample<2>& sample) {
  const PointCorrespondence& first = matches[static_cast<std::size_t>(sample[0])];
  const PointCorrespondence& second = matches[static_cast<std::size_t>(sample[1])];
  const auto before = axesOf(first.p_prev - position_prev, second.p_prev - position_prev);
  const auto now = axesOf(rayOf(first.left_px, camera), rayOf(second.left_px, camera));
  if (!before || !now) return {};
  Eigen::Isometry3d T_curr_prev = Eigen::Isometry3d::Identity();
  T_curr_prev.linear() = *now * before->transpose();
  T_curr_prev.translation() = -(T_curr_prev.linear() * position_prev);
  return {T_curr_prev};
}

/// \param tolerance [errors of an inlier].
bool agrees(const PointCorrespondence& match, const StereoCamera& camera,
            const Eigen::Isometry3d& T_curr_prev, double tolerance = 1.0) {
  const Eigen::Vector3d p = T_curr_prev * match.p_prev;
  if (!(p.z() > 0.1 * camera.baseline_m)) return false;
  const Eigen::Array2d error_px = camera.projectLeft(p) - match.left_px;
  const double max_error_px = tolerance * kMaxErrorPx * match.sigma_px;
  return (error_px.abs() <= max_error_px).all() &&  // false for NaN
         std::abs(camera.projectRight(p).x() - match.right_px.x()) <= max_error_px;
}

/// Number of samples of which one is free of outliers with probability kConfidence.
double samplesNeeded(int inliers, int size, std::size_t sample_size) {
  const double share = static_cast<double>(inliers) / size;
  const double all_inliers = std::pow(share, static_cast<double>(sample_size));
  return std::log(1.0 - kConfidence) / std::log1p(-std::min(all_inliers, 1.0 - 1e-12));
}

/// RANSAC. \param solve motions by a sample of kSize matches.
template <std::size_t kSize, typename Solve>
std::optional<MotionConsensus> ransac(const std::vector<PointCorrespondence>& matches,
                                      const StereoCamera& camera, const Solve& solve) {
  const int size = static_cast<int>(matches.size());
  if (size < kMinConsensus) return std::nullopt;
  MotionConsensus best;
  std::mt19937 generator(20170607U);
  double needed = kMaxSamples;
  for (int sample = 0; sample < needed; ++sample) {
    for (const Eigen::Isometry3d& T : solve(drawSample<kSize>(&generator, size))) {
      const auto inliers =
          static_cast<int>(std::count_if(matches.begin(), matches.end(), [&](const auto& match) {
            return agrees(match, camera, T);
          }));
      if (inliers <= best.num_inliers) continue;
      best.num_inliers = inliers;
      best.T_curr_prev = T;
      needed = std::min<double>(kMaxSamples, samplesNeeded(inliers, size, kSize));
    }
  }
  if (best.num_inliers < kMinConsensus) return std::nullopt;
  best.inliers.reserve(matches.size());
  for (const PointCorrespondence& match : matches)
    best.inliers.push_back(agrees(match, camera, best.T_curr_prev));
  return best;
}

}  // namespace

std::optional<MotionConsensus> findConsensus(const std::vector<PointCorrespondence>& matches,
                                             const StereoCamera& camera) {
  return ransac<3>(matches, camera, [&](const MinimalSample<3>& sample) {
    return solveThree(matches, camera, sample);
  });
}

std::optional<MotionConsensus> findRotation(const std::vector<PointCorrespondence>& far_matches,
                                            const StereoCamera& camera,
                                            const Eigen::Vector3d& position_prev) {
  return ransac<2>(far_matches, camera, [&](const MinimalSample<2>& sample) {
    return solveTwo(far_matches, camera, position_prev, sample);
  });
}

std::vector<PointCorrespondence> outliersOf(const std::vector<PointCorrespondence>& matches,
                                            const StereoCamera& camera,
                                            const Eigen::Isometry3d& T_curr_prev) {
  std::vector<PointCorrespondence> rest;
  for (const PointCorrespondence& match : matches) {
    if (!agrees(match, camera, T_curr_prev, kUnexplained)) rest.push_back(match);
  }
  return rest;
}

}  // namespace point_line_odometry
