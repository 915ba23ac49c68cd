
#include "features/image_pyramid.h"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

namespace point_line_odometry {
namespace {

using Eigen::Vector2f;

PointParameters levelsOf(int levels, double scale_factor) {
  PointParameters parameters;
  parameters.levels = levels;
  parameters.scale_factor = scale_factor;
  return parameters;
}

cv::Mat noise(int width, int height) {
  cv::Mat image(height, width, CV_8UC1);
  cv::RNG random(3);
  random.fill(image, cv::RNG::UNIFORM, 0, 256);
  return image;
}

TEST(ImagePyramid, FirstLevelIsTheImage) {
  const cv::Mat image = noise(200, 160);
  const ImagePyramid pyramid(image, levelsOf(3, 2.0));
  ASSERT_EQ(pyramid.levels.size(), 2U);  // 50 x 40 is too small
  EXPECT_EQ(pyramid.levels[0].data, image.data);
  EXPECT_EQ(pyramid.levels[1].size(), cv::Size(100, 80));
  EXPECT_EQ(pyramid.levels[1].type(), CV_8UC1);
  EXPECT_EQ(pyramid.ratio(0).x(), 1.0F);
  EXPECT_EQ(pyramid.ratio(1).x(), 2.0F);
  EXPECT_EQ(ImagePyramid(image, levelsOf(1, 2.0)).levels.size(), 1U);
}

TEST(ImagePyramid, PixelsAreMeansOfTheFinerOnes) {
  const cv::Mat image = noise(256, 192);
  const ImagePyramid pyramid(image, levelsOf(3, 2.0));
  ASSERT_EQ(pyramid.levels.size(), 3U);
  for (const int octave : {1, 2}) {
    const cv::Mat& level = pyramid.levels[static_cast<std::size_t>(octave)];
    const int side = 1 << octave;
    for (int y = 0; y < level.rows; ++y) {
      for (int x = 0; x < level.cols; ++x) {
        const cv::Mat covered = image(cv::Rect(side * x, side * y, side, side));
        ASSERT_NEAR(level.at<uchar>(y, x), cv::mean(covered)[0], octave == 1 ? 0.51 : 1.01);
      }
    }
  }
}

TEST(ImagePyramid, NoiseIsAveragedOut) {
  cv::Mat image(200, 300, CV_8UC1);
  cv::RNG(5).fill(image, cv::RNG::NORMAL, 100.0, 16.0);
  const ImagePyramid pyramid(image, levelsOf(3, 2.0));
  ASSERT_EQ(pyramid.levels.size(), 3U);
  for (const int octave : {1, 2}) {
    cv::Scalar mean;
    cv::Scalar deviation;
    cv::meanStdDev(pyramid.levels[static_cast<std::size_t>(octave)], mean, deviation);
    EXPECT_NEAR(mean[0], 100.0, 0.5);
    EXPECT_NEAR(deviation[0], 16.0 / (1 << octave), 0.5);
  }
}

TEST(ImagePyramid, ToLevelAndFromLevelAreInverse) {
  for (const cv::Size& size : {cv::Size(400, 300), cv::Size(401, 303), cv::Size(641, 479)}) {
    for (const double factor : {1.2, 1.5, 2.0}) {
      const ImagePyramid pyramid(noise(size.width, size.height), levelsOf(3, factor));
      ASSERT_EQ(pyramid.levels.size(), 3U);
      for (const int octave : {0, 1, 2}) {
        for (const Vector2f& p : {Vector2f(0.0F, 0.0F), Vector2f(17.3F, 250.8F),
                                  Vector2f(size.width - 1.0F, size.height - 1.0F)}) {
          const Vector2f there = pyramid.toLevel(p, octave);
          EXPECT_LT((pyramid.fromLevel(there, octave) - p).norm(), 1e-3F) << size << ' ' << octave;
        }
        // The corners of the image are those of its levels.
        const cv::Size level = pyramid.levels[static_cast<std::size_t>(octave)].size();
        const Vector2f end = pyramid.toLevel({size.width - 0.5F, size.height - 0.5F}, octave);
        EXPECT_LT((end - Vector2f(level.width - 0.5F, level.height - 0.5F)).norm(), 1e-3F);
        EXPECT_LT((pyramid.toLevel({-0.5F, -0.5F}, octave) - Vector2f(-0.5F, -0.5F)).norm(), 1e-5F);
      }
    }
  }
}

TEST(ImagePyramid, LevelsKeepThePositions) {
  // A ramp has the same brightness at corresponding pixels of all levels; odd sizes, too.
  for (const cv::Size& size : {cv::Size(240, 200), cv::Size(241, 203), cv::Size(199, 181)}) {
    cv::Mat ramp(size, CV_8UC1);
    for (int y = 0; y < ramp.rows; ++y) {
      for (int x = 0; x < ramp.cols; ++x) ramp.at<uchar>(y, x) = static_cast<uchar>(x);
    }
    const ImagePyramid pyramid(ramp, levelsOf(3, 2.0));
    ASSERT_EQ(pyramid.levels.size(), 3U);
    for (const int octave : {1, 2}) {
      const cv::Mat& level = pyramid.levels[static_cast<std::size_t>(octave)];
      double sum = 0.0;
      for (int x = 0; x < level.cols; ++x)
        sum += level.at<uchar>(20, x) - pyramid.fromLevel(Vector2f(x, 20.0F), octave).x();
      EXPECT_NEAR(sum / level.cols, 0.0, 0.7) << size;  // half a pixel of a level is 1 or 2
    }
  }
}

TEST(ImagePyramid, LeavesOutLevelsTooSmallForAKeypoint) {
  for (const cv::Size& size :
       {cv::Size(1, 1), cv::Size(3, 500), cv::Size(500, 3), cv::Size(40, 40), cv::Size(80, 300)}) {
    EXPECT_EQ(ImagePyramid(noise(size.width, size.height), levelsOf(8, 2.0)).levels.size(), 1U)
        << size;
  }
  EXPECT_EQ(ImagePyramid(noise(83, 300), levelsOf(8, 2.0)).levels.size(), 2U);
}

}  // namespace
}  // namespace point_line_odometry
