#include "common/area_reduction.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace point_line_odometry {
namespace {

cv::Mat noise(const cv::Size& size) {
  cv::Mat image(size, CV_8UC1);
  cv::RNG(11).fill(image, cv::RNG::UNIFORM, 0, 256);
  return image;
}

/// The largest difference to OpenCV's means of areas, and the share of pixels that differ.
void expectAsOpenCv(const cv::Mat& image, const cv::Size& size, double max_share) {
  cv::Mat expected;
  cv::resize(image, expected, size, 0.0, 0.0, cv::INTER_AREA);
  const cv::Mat reduced = areaReduced(image, size);
  ASSERT_EQ(reduced.size(), size);
  ASSERT_EQ(reduced.type(), CV_8UC1);
  cv::Mat difference;
  cv::absdiff(expected, reduced, difference);
  double largest = 0.0;
  cv::minMaxLoc(difference, nullptr, &largest);
  EXPECT_LE(largest, 1.0) << size;  // rounding
  EXPECT_LE(cv::countNonZero(difference), max_share * size.area()) << size;
}

TEST(AreaReduction, IsThatOfOpenCv) {
  const cv::Mat image = noise({401, 303});
  for (const double factor : {1.05, 1.2, 1.4, 1.9, 2.3, 3.7})
    expectAsOpenCv(image, {cvRound(image.cols / factor), cvRound(image.rows / factor)}, 0.002);
  expectAsOpenCv(image, {401, 100}, 0.002);
  expectAsOpenCv(image, {100, 303}, 0.002);
}

TEST(AreaReduction, TwoByTwoPixelsRoundToNearest) {
  const cv::Mat image = noise({64, 48});
  const cv::Mat reduced = areaReduced(image, {32, 24});
  for (int y = 0; y < reduced.rows; ++y) {
    for (int x = 0; x < reduced.cols; ++x) {
      const double mean = cv::mean(image(cv::Rect(2 * x, 2 * y, 2, 2)))[0];
      ASSERT_LE(std::abs(reduced.at<std::uint8_t>(y, x) - mean), 0.5);
    }
  }
}

TEST(AreaReduction, HalvingIsReducingToHalfTheSize) {
  cv::Mat half;
  for (const cv::Size& size : {cv::Size(64, 48), cv::Size(65, 49), cv::Size(2, 2)}) {
    const cv::Mat image = noise(size);
    halve(image, &half);
    ASSERT_EQ(half.size(), cv::Size(size.width / 2, size.height / 2));
    const cv::Mat even = image(cv::Rect(0, 0, 2 * half.cols, 2 * half.rows));
    EXPECT_EQ(cv::countNonZero(half != areaReduced(even, half.size())), 0) << size;
    for (int y = 0; y < half.rows; ++y) {
      for (int x = 0; x < half.cols; ++x) {
        const double mean = cv::mean(image(cv::Rect(2 * x, 2 * y, 2, 2)))[0];
        ASSERT_LE(std::abs(half.at<std::uint8_t>(y, x) - mean), 0.5);
      }
    }
  }
}

TEST(AreaReduction, TheSameSizeIsTheSameImage) {
  const cv::Mat image = noise({37, 21});
  EXPECT_EQ(cv::countNonZero(areaReduced(image, image.size()) != image), 0);
}

TEST(AreaReduction, ExtremesStayWithinEightBits) {
  for (const int value : {0, 255}) {
    const cv::Mat image(50, 71, CV_8UC1, cv::Scalar(value));
    EXPECT_EQ(cv::countNonZero(areaReduced(image, {51, 36}) != value), 0);
  }
}

TEST(AreaReduction, PartsOfImagesAndSmallestSizes) {
  const cv::Mat image = noise({90, 80});
  const cv::Mat part = image(cv::Rect(13, 7, 41, 29));
  EXPECT_EQ(cv::countNonZero(areaReduced(part, {29, 21}) != areaReduced(part.clone(), {29, 21})),
            0);
  EXPECT_NEAR(areaReduced(image, {1, 1}).at<std::uint8_t>(0, 0), cv::mean(image)[0], 0.51);
  EXPECT_EQ(areaReduced(noise({1, 1}), {1, 1}).size(), cv::Size(1, 1));
}

TEST(AreaReduction, SizesThatAreLargerAreRefused) {
  const cv::Mat image = noise({40, 30});
  EXPECT_THROW(areaReduced(image, {41, 30}), std::invalid_argument);
  EXPECT_THROW(areaReduced(image, {40, 0}), std::invalid_argument);
}

}  // namespace
}  // namespace point_line_odometry
