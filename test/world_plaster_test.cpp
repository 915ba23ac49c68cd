/// Dark rooms of plaster: noise and contrast of their images.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "world/synthetic_world.h"

namespace point_line_odometry {
namespace {

SyntheticWorldOptions plaster(int seed) {
  SyntheticWorldOptions options;
  options.scene = "plaster";
  options.seed = seed;
  return options;
}

/// A stationary camera: only the noise differs from frame to frame.
SyntheticWorldOptions standing(int seed) {
  SyntheticWorldOptions options = plaster(seed);
  options.speed = 0.0;
  options.rotation = 0.0;
  return options;
}

/// Standard deviations in the squares of an image, in ascending order.
std::vector<double> deviationsOfSquares(const cv::Mat& image, int size) {
  std::vector<double> deviations;
  for (int y = 0; y + size <= image.rows; y += size) {
    for (int x = 0; x + size <= image.cols; x += size) {
      cv::Scalar mean;
      cv::Scalar deviation;
      cv::meanStdDev(image(cv::Rect(x, y, size, size)), mean, deviation);
      deviations.push_back(deviation[0]);
    }
  }
  std::sort(deviations.begin(), deviations.end());
  return deviations;
}

TEST(Plaster, PixelsHaveANoiseOf5To8GreyLevels) {
  for (const int seed : {1, 2, 3}) {
    const SyntheticWorld world(standing(seed));
    cv::Mat difference;
    cv::subtract(world.render(0).left, world.render(1).left, difference, cv::noArray(), CV_32F);
    const std::vector<double> noise = deviationsOfSquares(cv::Mat(difference / std::sqrt(2.0)), 47);
    EXPECT_GT(noise.front(), 4.6) << seed;
    EXPECT_GT(noise[noise.size() / 10], 5.0) << seed;
    EXPECT_LT(noise.back(), 8.4) << seed;
  }
}

/// Spots and the light's drift without the noise, in squares that show no edge.
TEST(Plaster, ContrastOfSpotsIsBelowTheNoise) {
  for (const int seed : {1, 2, 3}) {
    SyntheticWorldOptions options = standing(seed);
    options.noise = 0.0;
    const std::vector<double> spots =
        deviationsOfSquares(SyntheticWorld(options).render(0).left, 47);
    EXPECT_GT(spots[spots.size() / 10], 0.4) << seed;  // there is something to see
    EXPECT_LT(spots[spots.size() / 2], 3.0) << seed;
  }
}

TEST(Plaster, FramesTakenSparselyAreThoseOfTheSameFlight) {
  SyntheticWorldOptions options = plaster(4);
  options.noise = 0.0;
  options.frame_rate_hz = 20.0;
  const SyntheticWorld dense(options);
  options.frame_rate_hz = 2.5;
  const SyntheticWorld sparse(options);
  EXPECT_EQ(sparse.pose(3).stamp_ns, dense.pose(24).stamp_ns);
  EXPECT_TRUE(sparse.pose(3).T_world_camera.isApprox(dense.pose(24).T_world_camera, 1e-12));
  EXPECT_EQ(cv::norm(sparse.render(3).right, dense.render(24).right, cv::NORM_INF), 0.0);
  EXPECT_NEAR(static_cast<double>(sparse.framesForLength(100.0)),
              static_cast<double>(dense.framesForLength(100.0)) / 8.0, 4.0);
}

TEST(Plaster, OptionsOverrideTheScenesOwnExposure) {
  const SyntheticWorldOptions own = plaster(5);
  SyntheticWorldOptions asked = own;
  asked.motion_blur_ms = 15.0;
  asked.noise = 8.0;
  const cv::Mat image = SyntheticWorld(own).render(30).left;
  EXPECT_EQ(cv::norm(image, SyntheticWorld(asked).render(30).left, cv::NORM_INF), 0.0);
  asked.motion_blur_ms = 0.0;
  asked.noise = 0.0;
  const cv::Mat clear = SyntheticWorld(asked).render(30).left;
  cv::Mat noise;
  cv::subtract(image, clear, noise, cv::noArray(), CV_32F);
  EXPECT_GT(deviationsOfSquares(noise, 47).front(), 4.0);
  EXPECT_LT(deviationsOfSquares(clear, 47).front(), 3.0);
}

}  // namespace
}  // namespace point_line_odometry
