#pragma once

/// \file
/// Seeded synthetic data with known ground truth, shared by the tests of several stages: cameras
/// and motions, matches of points and lines with noise, and rendered images of a tiled room.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <opencv2/core.hpp>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "features/features.h"
#include "geometry/se3.h"
#include "geometry/triangulation.h"
#include "motion/correspondence.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {
namespace synthetic {

/// A camera whose numbers all differ, so that a mixed-up one shows.
inline StereoCamera camera() {
  StereoCamera camera;
  camera.fx = 700.0;
  camera.fy = 680.0;
  camera.cx = 330.0;
  camera.cy = 235.0;
  camera.baseline_m = 0.4;
  camera.width = 640;
  camera.height = 480;
  return camera;
}

/// A camera with which numbers are easy to work out by hand: 5 m away is a disparity of 150 px.
inline StereoCamera handCamera() {
  StereoCamera result = camera();
  result.fx = result.fy = 1500.0;
  result.cx = 600.0;
  result.cy = 200.0;
  result.baseline_m = 0.5;
  return result;
}

inline Eigen::Isometry3d transform(const Eigen::Vector3d& rotation_vector,
                                   const Eigen::Vector3d& t) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = expSO3(rotation_vector);
  T.translation() = t;
  return T;
}

/// A motion with all six components, as T_curr_prev.
inline Eigen::Isometry3d motion() { return transform({0.02, -0.03, 0.015}, {0.06, -0.04, -0.35}); }

class Random {
 public:
  explicit Random(unsigned seed) : generator_(seed) {}
  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(generator_);
  }
  double normal(double sigma) { return sigma * normal_(generator_); }

  // Of vectors the last coordinate is drawn first. (As arguments of a constructor, compilers would
  // differ in the order.)
  template <int N>
  Eigen::Matrix<double, N, 1> uniform(const Eigen::Matrix<double, N, 1>& low,
                                      const Eigen::Matrix<double, N, 1>& high) {
    Eigen::Matrix<double, N, 1> v;
    for (int i = N - 1; i >= 0; --i) v[i] = uniform(low[i], high[i]);
    return v;
  }
  template <int N>
  Eigen::Matrix<double, N, 1> normals(double sigma) {
    Eigen::Matrix<double, N, 1> v;
    for (int i = N - 1; i >= 0; --i) v[i] = normal(sigma);
    return v;
  }
  std::uint64_t bits() { return generator_(); }

 private:
  std::mt19937_64 generator_;
  std::normal_distribution<double> normal_;
};

inline Descriptor randomDescriptor(Random* random) {
  return {random->bits(), random->bits(), random->bits(), random->bits()};
}

/// The same descriptor with its first `count` bits flipped.
inline Descriptor flipped(Descriptor descriptor, int count) {
  for (int bit = 0; bit < count; ++bit) descriptor[bit / 64] ^= std::uint64_t{1} << (bit % 64);
  return descriptor;
}

/// A place that the left camera sees, at a depth from 3 to 15 m.
inline Eigen::Vector3d visiblePoint(const StereoCamera& camera, Random* random) {
  const Eigen::Vector2d pixel = random->uniform<2>(
      {60.0, 20.0},
      {static_cast<double>(camera.width) - 20.0, static_cast<double>(camera.height) - 20.0});
  return backProject(camera, pixel, camera.fx * camera.baseline_m / random->uniform(3.0, 15.0));
}

/// Moves a pixel across a direction.
inline Eigen::Vector2d across(const Eigen::Vector2d& pixel, const Eigen::Vector2d& direction,
                              double shift_px) {
  return pixel + shift_px * Eigen::Vector2d(-direction.y(), direction.x()).normalized();
}

struct MatchOptions {
  int points = 60;
  int lines = 30;
  double noise_px = 0.0;  ///< of each pixel coordinate of points, and of end points across lines
  double sigma_px = 0.3;  ///< what the matches say their noise is
  double disparity_error_px = 0.0;  ///< by which all disparities are too large
  double outlier_share = 0.0;       ///< of matches whose pixels in frame k belong to something else
};

inline PointCorrespondence pointMatch(const StereoCamera& camera,
                                      const Eigen::Isometry3d& T_curr_prev,
                                      const MatchOptions& options, Random* random) {
  const auto noisy = [&](const Eigen::Vector2d& p) {
    return Eigen::Vector2d(p + random->normals<2>(options.noise_px));
  };
  const Eigen::Vector3d p = visiblePoint(camera, random);
  // Noise is drawn in statements of their own: compilers differ in the order of arguments.
  const Eigen::Vector2d error_px(-options.disparity_error_px, 0.0);  // of right pixels
  const Eigen::Vector2d right_px = noisy(camera.projectRight(p) + error_px);
  const Eigen::Vector2d left_px = noisy(camera.projectLeft(p));
  const auto triangulated = triangulatePoint(camera, left_px, right_px.x(), options.sigma_px, 0.1);
  PointCorrespondence match;
  match.p_prev = triangulated.value().p_camera;
  match.covariance = triangulated->covariance;
  match.left_px = noisy(camera.projectLeft(T_curr_prev * p));
  match.right_px = noisy(camera.projectRight(T_curr_prev * p) + error_px);
  match.sigma_px = options.sigma_px;
  return match;
}

/// A segment of 1 to 3 m, well off the epipolar direction, whose pixels in frame k have slid along
/// the line.
inline LineCorrespondence lineMatch(const StereoCamera& camera,
                                    const Eigen::Isometry3d& T_curr_prev,
                                    const MatchOptions& options, Random* random) {
  Eigen::Vector3d start;
  Eigen::Vector3d end;
  Eigen::Vector2d direction;
  do {
    start = visiblePoint(camera, random);
    end = start + random->uniform<3>({-1.5, -2.0, -1.0}, {1.5, 2.0, 1.0});
    direction = (camera.projectLeft(end) - camera.projectLeft(start)).normalized();
  } while ((end - start).norm() < 1.0 || std::abs(direction.y()) < 0.6);

  const auto noisySegment = [&](const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    return LineSegment{across(a, b - a, random->normal(options.noise_px)).cast<float>(),
                       across(b, b - a, random->normal(options.noise_px)).cast<float>()};
  };
  const LineSegment left = noisySegment(camera.projectLeft(start), camera.projectLeft(end));
  const auto projectRight = [&](const Eigen::Vector3d& p) -> Eigen::Vector2d {
    return camera.projectRight(p) - Eigen::Vector2d(options.disparity_error_px, 0.0);
  };
  const LineSegment right = noisySegment(projectRight(start), projectRight(end));
  const auto triangulated = triangulateLine(camera, left, right, options.sigma_px, {});
  LineCorrespondence match;
  match.covariance = triangulated.value().covariance;
  // Segments are of floats: exact data is put in as such.
  match.start_prev = options.noise_px > 0.0 ? triangulated->start_camera : start;
  match.end_prev = options.noise_px > 0.0 ? triangulated->end_camera : end;
  const Eigen::Vector3d a = T_curr_prev * (start + 0.1 * (end - start));
  const Eigen::Vector3d b = T_curr_prev * (start + 0.8 * (end - start));
  const auto seen = [&](const Eigen::Vector2d& p, const Eigen::Vector2d& other) {
    return across(p, other - p, random->normal(options.noise_px));
  };
  match.left_start_px = seen(camera.projectLeft(a), camera.projectLeft(b));
  match.left_end_px = seen(camera.projectLeft(b), camera.projectLeft(a));
  match.right_start_px = seen(projectRight(a), projectRight(b));
  match.right_end_px = seen(projectRight(b), projectRight(a));
  match.sigma_px = options.sigma_px;
  return match;
}

/// Matches under a known motion; the first ones of each kind are the outliers.
inline Correspondences matches(const StereoCamera& camera, const Eigen::Isometry3d& T_curr_prev,
                               const MatchOptions& options, unsigned seed) {
  Random random(seed);
  Correspondences all;
  for (int i = 0; i < options.points; ++i) {
    all.points.push_back(pointMatch(camera, T_curr_prev, options, &random));
    if (i >= options.outlier_share * options.points) continue;
    const Eigen::Vector2d away = random.uniform<2>({8.0, -60.0}, {60.0, -8.0});
    all.points.back().left_px += away;
    all.points.back().right_px += away;
  }
  for (int i = 0; i < options.lines; ++i) {
    all.lines.push_back(lineMatch(camera, T_curr_prev, options, &random));
    if (i >= options.outlier_share * options.lines) continue;
    LineCorrespondence& line = all.lines.back();
    const Eigen::Vector2d away(random.uniform(10.0, 60.0), 0.0);
    for (Eigen::Vector2d* pixel :
         {&line.left_start_px, &line.left_end_px, &line.right_start_px, &line.right_end_px}) {
      *pixel += away;
    }
  }
  return all;
}

// --- Rendered images

/// Camera of the rendered images.
inline StereoCamera roomCamera() {
  StereoCamera camera;
  camera.fx = camera.fy = 300.0;
  camera.cx = 199.5;
  camera.cy = 139.5;
  camera.baseline_m = 0.2;
  camera.width = 400;
  camera.height = 280;
  return camera;
}

/// For the images of the room as they are, not enlarged: for the time, and so that numbers in
/// pixels are of these images.
inline Parameters roomParameters() {
  Parameters parameters;
  parameters.tracking.min_megapixels = 0.0;
  return parameters;
}

/// Brightness of a wall's tile; the same for the same numbers.
inline double tileBrightness(int wall, int row, int column) {
  std::uint32_t h = 2166136261U;
  for (const int number : {wall, row, column}) {
    h = (h ^ static_cast<std::uint32_t>(number + 1000)) * 16777619U;
    h ^= h >> 13;
  }
  h *= 0x5bd1e995U;
  h ^= h >> 15;
  return 30.0 + h % 200;
}

/// What a camera at a place of a room of 6 x 4 x 12 m with tiled walls sees; anti-aliased by 3 x 3
/// rays a pixel.
inline cv::Mat renderRoom(const StereoCamera& camera, const Eigen::Isometry3d& T_room_camera) {
  constexpr int kRays = 3;
  constexpr double kTile = 0.4;
  const Eigen::Vector3d low(-3.0, -2.2, -4.0);
  const Eigen::Vector3d high(3.0, 1.8, 8.0);
  const Eigen::Vector3d origin = T_room_camera.translation();
  cv::Mat image(camera.height, camera.width, CV_8UC1);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      double sum = 0.0;
      for (int ray = 0; ray < kRays * kRays; ++ray) {
        const double u = x - 0.5 + (ray % kRays + 0.5) / kRays;
        const double v = y - 0.5 + (ray / kRays + 0.5) / kRays;
        const Eigen::Vector3d direction =
            T_room_camera.linear() *
            Eigen::Vector3d((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0);
        double nearest = 1e9;
        int wall = 0;
        for (int axis = 0; axis < 3; ++axis) {
          if (direction[axis] == 0.0) continue;
          const bool far_side = direction[axis] > 0.0;
          const double range = ((far_side ? high : low)[axis] - origin[axis]) / direction[axis];
          if (range >= nearest) continue;
          nearest = range;
          wall = 2 * axis + (far_side ? 1 : 0);
        }
        const Eigen::Vector3d hit = origin + nearest * direction;
        const int first = wall / 2 == 0 ? 1 : 0;
        const int second = wall / 2 == 2 ? 1 : 2;
        sum += tileBrightness(wall, static_cast<int>(std::floor(hit[first] / kTile)),
                              static_cast<int>(std::floor(hit[second] / kTile)));
      }
      image.at<uchar>(y, x) = cv::saturate_cast<uchar>(sum / (kRays * kRays));
    }
  }
  return image;
}

/// What the stereo pair sees, its left camera at a place of the room.
inline StereoImages renderStereo(const StereoCamera& camera, const Eigen::Isometry3d& T_room_camera,
                                 std::int64_t stamp_ns) {
  Eigen::Isometry3d T_left_right = Eigen::Isometry3d::Identity();
  T_left_right.translation().x() = camera.baseline_m;
  return {renderRoom(camera, T_room_camera), renderRoom(camera, T_room_camera * T_left_right),
          stamp_ns};
}

constexpr std::int64_t kPeriodNs = 100000000;
constexpr int kFrames = 8;

/// True pose of frame k: forwards with a gentle curve.
inline Eigen::Isometry3d truePose(int k) {
  return transform(k * Eigen::Vector3d(0.002, -0.012, 0.003),
                   k * Eigen::Vector3d(0.02, -0.005, 0.12));
}

/// Frame k of a drive, rendered once.
inline const StereoImages& frame(int k) {
  static const std::vector<StereoImages> frames = [] {
    std::vector<StereoImages> rendered;
    for (int i = 0; i < kFrames; ++i)
      rendered.push_back(renderStereo(roomCamera(), truePose(i), (i + 1) * kPeriodNs));
    return rendered;
  }();
  return frames.at(static_cast<std::size_t>(k));
}

inline StereoImages stamped(StereoImages images, std::int64_t stamp_ns) {
  images.stamp_ns = stamp_ns;
  return images;
}

/// Frame k of a camera at some pose in the room, rendered once for each name. A copy: tests draw in
/// it.
inline StereoImages room(const std::string& name, const Eigen::Isometry3d& T_room_camera, int k) {
  static std::map<std::string, StereoImages> rendered;
  StereoImages& images = rendered[name];
  if (images.left.empty()) images = renderStereo(roomCamera(), T_room_camera, 0);
  return {images.left.clone(), images.right.clone(), (k + 1) * kPeriodNs};
}

/// Frame k of the drive of truePose(), as far as one likes.
inline StereoImages drive(int k) { return room("drive " + std::to_string(k), truePose(k), k); }

constexpr int kPassingBegins = 4;

/// The same, but from frame `begins` on what takes seventy percent of the view moves to the
/// right.
inline StereoImages passingFrom(int begins, int k) {
  StereoImages images = drive(k);
  const double moved_m = 0.1 * std::max(0, k - begins + 1);
  const StereoImages other =
      room("passing " + std::to_string(k) + " from " + std::to_string(begins),
           truePose(k) * transform(Eigen::Vector3d::Zero(), {-moved_m, 0.0, 0.0}), k);
  const cv::Rect part(0, 0, 7 * roomCamera().width / 10, roomCamera().height);
  for (const auto& [to, from] :
       {std::make_pair(&images.left, &other.left), std::make_pair(&images.right, &other.right)}) {
    *to = to->clone();
    (*from)(part).copyTo((*to)(part));
  }
  return images;
}

inline StereoImages passing(int k) { return passingFrom(kPassingBegins, k); }

/// With Gaussian noise of this standard deviation [grey levels], by the stamp.
inline StereoImages noisy(StereoImages images, double sigma) {
  Random random(static_cast<unsigned>(images.stamp_ns / kPeriodNs));
  for (cv::Mat* image : {&images.left, &images.right}) {
    *image = image->clone();
    for (auto pixel = image->begin<uchar>(); pixel != image->end<uchar>(); ++pixel) {
      *pixel = cv::saturate_cast<uchar>(*pixel + random.normal(sigma));
    }
  }
  return images;
}

inline StereoImages black(std::int64_t stamp_ns) {
  const cv::Mat image(roomCamera().height, roomCamera().width, CV_8UC1, cv::Scalar(0));
  return {image, image, stamp_ns};
}

}  // namespace synthetic
}  // namespace point_line_odometry
