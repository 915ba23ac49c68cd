#include "matching/correlation_patch.h"

#include <gtest/gtest.h>

#include <limits>
#include <opencv2/imgproc.hpp>

namespace point_line_odometry {
namespace {

using Eigen::AlignedBox2f;
using Eigen::Vector2f;

const Vector2f kPixel(150.0F, 100.0F);

AlignedBox2f around(const Vector2f& centre, float radius) {
  const Vector2f reach(radius, radius);
  return {centre - reach, centre + reach};
}

/// Blurred spots of a standard deviation of 10 grey levels.
cv::Mat spots(unsigned seed) {
  cv::Mat noise(200, 300, CV_32FC1);
  cv::RNG(seed).fill(noise, cv::RNG::NORMAL, 0.0, 1.0);
  cv::GaussianBlur(noise, noise, {}, 2.5);
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(noise, mean, deviation);
  return noise * (10.0 / deviation[0]) + 80.0;
}

cv::Mat toImage(const cv::Mat& brightness, double noise = 0.0, unsigned seed = 1) {
  cv::Mat grain(brightness.size(), CV_32FC1);
  cv::RNG(seed).fill(grain, cv::RNG::NORMAL, 0.0, noise);
  cv::Mat image;
  cv::Mat(brightness + grain).convertTo(image, CV_8UC1);
  return image;
}

cv::Mat shifted(const cv::Mat& brightness, float x, float y) {
  cv::Mat result;
  const cv::Mat motion = (cv::Mat_<float>(2, 3) << 1.0F, 0.0F, x, 0.0F, 1.0F, y);
  cv::warpAffine(brightness, result, motion, brightness.size(), cv::INTER_CUBIC,
                 cv::BORDER_REFLECT);
  return result;
}

TEST(CorrelationPatch, FindsAShiftToSubPixels) {
  const cv::Mat brightness = spots(1);
  const Vector2f shift(5.3F, -3.6F);
  const CorrelationPatch patch(toImage(brightness), kPixel);
  const auto found =
      patch.find(toImage(shifted(brightness, shift.x(), shift.y())), around(kPixel, 10.0F));
  ASSERT_TRUE(found);
  EXPECT_LT((*found - kPixel - shift).norm(), 0.15F);
}

TEST(CorrelationPatch, KeepsTheFractionOfItsPixel) {
  const cv::Mat image = toImage(spots(2));
  const Vector2f pixel(120.4F, 80.7F);
  const auto found = CorrelationPatch(image, pixel).find(image, around(pixel, 6.0F));
  ASSERT_TRUE(found);
  EXPECT_LT((*found - pixel).norm(), 0.15F);
}

TEST(CorrelationPatch, IsInvariantToGainAndOffset) {
  const cv::Mat brightness = spots(3);
  const CorrelationPatch patch(toImage(brightness), kPixel);
  const auto found =
      patch.find(toImage(0.5 * shifted(brightness, 4.0F, 2.0F) + 90.0), around(kPixel, 8.0F));
  ASSERT_TRUE(found);
  EXPECT_LT((*found - kPixel - Vector2f(4.0F, 2.0F)).norm(), 0.3F);
}

TEST(CorrelationPatch, FindsItInNoiseAsStrongAsTheTexture) {
  int right = 0;
  constexpr unsigned kTrials = 40;
  for (unsigned seed = 0; seed < kTrials; ++seed) {
    const cv::Mat brightness = spots(10 + seed);
    const CorrelationPatch patch(toImage(brightness, 8.0, 100 + seed), kPixel);
    const auto found = patch.find(toImage(shifted(brightness, -6.0F, 3.0F), 8.0, 200 + seed),
                                  around(kPixel, 12.0F));
    right += found && (*found - kPixel - Vector2f(-6.0F, 3.0F)).norm() < 1.5F ? 1 : 0;
  }
  EXPECT_GE(right, 32);
}

TEST(CorrelationPatch, NoiseAloneHasNoMatch) {
  int found = 0;
  for (unsigned seed = 0; seed < 40; ++seed) {
    const cv::Mat grey(200, 300, CV_32FC1, cv::Scalar(80.0));
    const CorrelationPatch patch(toImage(grey, 8.0, 100 + seed), kPixel);
    found += patch.find(toImage(grey, 8.0, 200 + seed), around(kPixel, 12.0F)) ? 1 : 0;
  }
  EXPECT_EQ(found, 0);
}

TEST(CorrelationPatch, UniformPatchesHaveNoMatch) {
  const cv::Mat grey(200, 300, CV_8UC1, cv::Scalar(80));
  const cv::Mat image = toImage(spots(4));
  EXPECT_FALSE(CorrelationPatch(grey, kPixel).find(image, around(kPixel, 5.0F)));
  EXPECT_FALSE(CorrelationPatch(image, kPixel).find(grey, around(kPixel, 5.0F)));
}

TEST(CorrelationPatch, ReadsNoPixelOutsideOfTheImage) {
  const cv::Mat image = toImage(spots(5));
  for (const Vector2f& corner : {Vector2f(0.0F, 0.0F), Vector2f(299.0F, 0.0F),
                                 Vector2f(0.0F, 199.0F), Vector2f(299.0F, 199.0F)}) {
    EXPECT_FALSE(CorrelationPatch(image, corner).find(image, around(kPixel, 5.0F)));
    const auto found = CorrelationPatch(image, kPixel).find(image, around(corner, 20.0F));
    EXPECT_TRUE(!found || (*found - kPixel).norm() > 20.0F);
  }
  const Vector2f near_corner(9.0F, 9.0F);
  const auto found = CorrelationPatch(image, near_corner).find(image, around(near_corner, 30.0F));
  ASSERT_TRUE(found);
  EXPECT_LT((*found - near_corner).norm(), 0.15F);
  EXPECT_FALSE(CorrelationPatch(image, kPixel).find(image, around(Vector2f(-500.0F, 1e9F), 5.0F)));
  const Vector2f nowhere = Vector2f::Constant(std::numeric_limits<float>::quiet_NaN());
  EXPECT_FALSE(CorrelationPatch(image, kPixel).find(image, around(nowhere, 5.0F)));
  EXPECT_FALSE(CorrelationPatch(image, nowhere).find(image, around(kPixel, 5.0F)));
}

}  // namespace
}  // namespace point_line_odometry
