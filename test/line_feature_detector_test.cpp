#include "features/line_feature_detector.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "matching/descriptor_distance.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {
namespace {

using Eigen::Vector2f;

constexpr int kSize = 200;
const Vector2f kMiddle(100.3F, 99.8F);

/// A step between two grey levels along a line through kMiddle, blurred by half a pixel, with
/// noise; bright where the normal points to.
cv::Mat step(double normal_rad, double contrast, double noise = 0.0) {
  const Vector2f normal(std::cos(normal_rad), std::sin(normal_rad));
  cv::Mat image(kSize, kSize, CV_32FC1);
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x) {
      const float d = normal.dot(Vector2f(static_cast<float>(x), static_cast<float>(y)) - kMiddle);
      image.at<float>(y, x) =
          static_cast<float>(60.0 + 0.5 * contrast * (1.0 + std::erf(d / std::sqrt(0.5))));
    }
  }
  cv::Mat grain(image.size(), CV_32FC1);
  cv::RNG(5).fill(grain, cv::RNG::NORMAL, 0.0, noise);
  cv::Mat bytes;
  cv::Mat(image + grain).convertTo(bytes, CV_8UC1);
  return bytes;
}

std::vector<LineFeature> detect(const cv::Mat& image, const LineParameters& parameters = {},
                                LineResolution resolution = LineResolution::kCoarseToFine) {
  return LineFeatureDetector(parameters, LineDetectorKind::kEdgeChains).detect(image, resolution);
}

/// Largest distance of the ends from the edge.
float offsetOf(const LineSegment& segment, double normal_rad) {
  const Vector2f normal(std::cos(normal_rad), std::sin(normal_rad));
  return std::max(std::abs(normal.dot(segment.start - kMiddle)),
                  std::abs(normal.dot(segment.end - kMiddle)));
}

TEST(LineFeatureDetector, LocatesEdgesInTheImageItself) {
  for (int degrees = 0; degrees < 360; degrees += 10) {
    const double angle = (degrees + 0.7) * M_PI / 180.0;
    const cv::Mat image = step(angle, 100.0, 2.0);
    const std::vector<LineFeature> lines = detect(image);
    ASSERT_EQ(lines.size(), 1U) << degrees;
    EXPECT_EQ(lines[0].scale, 1.0F);
    EXPECT_LT(offsetOf(lines[0].segment, angle), 0.08F) << degrees;
    EXPECT_GT(lines[0].segment.length(), 150.0F) << degrees;
    const Vector2f along = lines[0].segment.direction();
    EXPECT_GT(-along.y() * std::cos(angle) + along.x() * std::sin(angle), 0.9999)
        << degrees << ": brighter on the right";
  }
}

/// Of an edge like this, single pixels say little.
TEST(LineFeatureDetector, FindsEdgesInTheNoiseOfAPixel) {
  int coarse_to_fine = 0;
  int one_size = 0;
  const auto is_found = [](const std::vector<LineFeature>& lines, double angle) {
    return std::any_of(lines.begin(), lines.end(), [&](const LineFeature& line) {
      return line.segment.length() > 100.0F && offsetOf(line.segment, angle) < 1.5F;
    });
  };
  for (int degrees = 0; degrees < 360; degrees += 10) {
    const double angle = (degrees + 0.7) * M_PI / 180.0;
    const cv::Mat image = step(angle, 12.0, 6.0);
    coarse_to_fine += is_found(detect(image), angle) ? 1 : 0;
    one_size += is_found(detect(image, {}, LineResolution::kFull), angle) ? 1 : 0;
  }
  EXPECT_GE(coarse_to_fine, 22);
  EXPECT_LE(one_size, 15);
}

/// Too weak for an edge of the image itself, it is as exact as a pixel of half the size.
TEST(LineFeatureDetector, AnEdgeTooWeakForTheImageItselfHasAScaleOfTwo) {
  LineParameters parameters;
  const double angle = 0.3;
  cv::Mat image;
  cv::GaussianBlur(step(angle, 40.0), image, {}, 4.0);  // 4 grey levels per pixel
  parameters.min_gradient = 5.0;
  for (const float scale : {2.0F, 1.0F}) {
    const std::vector<LineFeature> lines = detect(image, parameters);
    ASSERT_FALSE(lines.empty());
    for (const LineFeature& line : lines) {
      EXPECT_EQ(line.scale, scale);
      EXPECT_LT(offsetOf(line.segment, angle), 0.5F);
    }
    parameters.min_gradient = 2.0;
  }
}

TEST(LineFeatureDetector, LengthsAreThoseOfTheImage) {
  cv::Mat image(kSize, kSize, CV_8UC1, cv::Scalar(60));
  image(cv::Range(20, 80), cv::Range(40, 70)).setTo(180);
  LineParameters parameters;
  parameters.min_length_px = 45.0;
  const std::vector<LineFeature> lines = detect(image, parameters);
  ASSERT_EQ(lines.size(), 2U) << "of the bar's sides, not of its ends";
  for (const LineFeature& line : lines) EXPECT_NEAR(line.segment.length(), 60.0F, 10.0F);
  parameters.min_length_px = 65.0;
  EXPECT_TRUE(detect(image, parameters).empty());
  parameters.min_length_px = 20.0;
  EXPECT_EQ(detect(image, parameters).size(), 4U);
  parameters.max_count = 3;
  EXPECT_EQ(detect(image, parameters).size(), 3U);
}

/// Soft texture with two upright edges of the same polarity, at columns 99.5 and 299.5.
cv::Mat texturedEdges(int seed, double contrast) {
  cv::Mat texture(kSize, 2 * kSize, CV_32FC1);
  cv::RNG(static_cast<std::uint64_t>(seed)).fill(texture, cv::RNG::NORMAL, 0.0, 1.0);
  cv::GaussianBlur(texture, texture, {}, 4.0);
  cv::normalize(texture, texture, 30.0, 0.0, cv::NORM_INF);
  for (const int x : {100, 300}) cv::Mat(texture.colRange(x, x + 100)) += contrast;
  cv::Mat image;
  texture.convertTo(image, CV_8UC1, 1.0, contrast > 0.0 ? 90.0 : 160.0);
  return image;
}

/// The descriptor of the one long edge at a column.
Descriptor descriptorAt(const cv::Mat& image, float column, LineResolution resolution) {
  Descriptor descriptor{};
  int count = 0;
  for (const LineFeature& line : detect(image, {}, resolution)) {
    if (line.segment.length() < 100.0F || std::abs(line.segment.middle().x() - column) > 2.0F)
      continue;
    descriptor = line.descriptor;
    ++count;
  }
  EXPECT_EQ(count, 1) << "edges at column " << column;
  return descriptor;
}

/// Also of edges that are found in another way: from one frame to the next that may change.
TEST(LineFeatureDetector, DescriptorsTellEdgesApart) {
  constexpr LineResolution kResolutions[] = {LineResolution::kFull, LineResolution::kCoarseToFine};
  for (const LineResolution first : kResolutions) {
    for (const LineResolution second : kResolutions) {
      double same = 0.0;
      double other = 0.0;
      int count = 0;
      for (const double contrast : {70.0, -70.0}) {
        for (int seed = 1; seed <= 6; ++seed, ++count) {
          const cv::Mat image = texturedEdges(seed, contrast);
          const cv::Mat moved = image.colRange(7, 2 * kSize).clone();
          const Descriptor again = descriptorAt(moved, 92.5F, second);
          const int distance = hammingDistance(descriptorAt(image, 99.5F, first), again);
          if (first == second) {
            EXPECT_LT(distance, 20) << seed;
          }
          same += distance;
          other += hammingDistance(descriptorAt(image, 299.5F, first), again);
        }
      }
      EXPECT_LT(same / count, first == second ? 12.0 : 24.0);
      EXPECT_GT(other / count, same / count + 15.0);
    }
  }
}

/// A detector has its own memory for each of them.
TEST(LineFeatureDetector, ResolutionsMayAlternate) {
  LineFeatureDetector kept({}, LineDetectorKind::kEdgeChains);
  for (int seed = 1; seed <= 3; ++seed) {
    const cv::Mat image = texturedEdges(seed, 70.0);
    for (const LineResolution resolution : {LineResolution::kFull, LineResolution::kCoarseToFine}) {
      const std::vector<LineFeature> lines = kept.detect(image, resolution);
      const std::vector<LineFeature> fresh = detect(image, {}, resolution);
      ASSERT_EQ(lines.size(), fresh.size());
      ASSERT_FALSE(lines.empty());
      for (std::size_t i = 0; i < lines.size(); ++i) {
        EXPECT_EQ(lines[i].segment.start, fresh[i].segment.start);
        EXPECT_EQ(lines[i].segment.end, fresh[i].segment.end);
        EXPECT_EQ(lines[i].descriptor, fresh[i].descriptor);
      }
    }
  }
}

TEST(LineFeatureDetector, EdgesEndAtMaskedPixels) {
  const cv::Mat image = step(0.0, 100.0);  // upright, at column 100
  cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(255));
  mask.rowRange(121, kSize).setTo(0);
  LineFeatureDetector detector({}, LineDetectorKind::kEdgeChains);
  const std::vector<LineFeature> lines =
      detector.detect(image, LineResolution::kCoarseToFine, FeatureMask(mask));
  ASSERT_EQ(lines.size(), 1U);
  for (const Vector2f& end : {lines[0].segment.start, lines[0].segment.end})
    EXPECT_LT(end.y(), 121.0F - FeatureMask::kEdgeMargin);
  EXPECT_GT(lines[0].segment.length(), 90.0F);
  const FeatureMask all(cv::Mat(mask.size(), CV_8UC1, cv::Scalar(0)));
  EXPECT_TRUE(detector.detect(image, LineResolution::kCoarseToFine, all).empty());
}

TEST(LineFeatureDetector, OddAndTinySizes) {
  LineFeatureDetector detector({}, LineDetectorKind::kEdgeChains);
  const cv::Mat image = step(0.0, 100.0);
  for (const int cut : {0, 1}) {
    const cv::Mat odd = image(cv::Rect(0, 0, kSize - cut, kSize - cut));
    const std::vector<LineFeature> lines = detector.detect(odd, LineResolution::kCoarseToFine);
    ASSERT_EQ(lines.size(), 1U);
    EXPECT_LT(offsetOf(lines[0].segment, 0.0), 0.08F);
  }
  for (const cv::Size& size : {cv::Size(1, 1), cv::Size(1, 50), cv::Size(2, 2), cv::Size(5, 7)}) {
    cv::Mat noise(size, CV_8UC1);
    cv::randu(noise, 0, 256);
    EXPECT_TRUE(detector.detect(noise, LineResolution::kCoarseToFine).empty()) << size;
  }
}

TEST(LineFeatureDetector, IsCoarseToFineWherePointsAreMany) {
  LineParameters parameters;
  parameters.coarse_to_fine_points = 300;
  EXPECT_EQ(lineResolutionAfter(0, parameters), LineResolution::kFull);
  EXPECT_EQ(lineResolutionAfter(299, parameters), LineResolution::kFull);
  EXPECT_EQ(lineResolutionAfter(300, parameters), LineResolution::kCoarseToFine);
  parameters.coarse_to_fine_points = 0;
  EXPECT_EQ(lineResolutionAfter(0, parameters), LineResolution::kCoarseToFine);
}

TEST(LineFeatureDetector, WithoutADetectorThereAreNone) {
  LineFeatureDetector detector({}, LineDetectorKind::kNone);
  for (const LineResolution resolution : {LineResolution::kFull, LineResolution::kCoarseToFine})
    EXPECT_TRUE(detector.detect(step(0.0, 100.0), resolution).empty());
}

TEST(LineFeatureDetector, LsdTakesTheImageItself) {
  if (!LsdDetector::isAvailable()) GTEST_SKIP() << "this OpenCV has no line segment detector";
  const cv::Mat image = step(0.4, 100.0);
  const std::vector<LineFeature> lines =
      LineFeatureDetector({}, LineDetectorKind::kLsd).detect(image, LineResolution::kCoarseToFine);
  const std::vector<LineSegment> segments = LsdDetector({}).detect(image);
  ASSERT_EQ(lines.size(), segments.size());
  ASSERT_FALSE(lines.empty());
  EXPECT_EQ(lines[0].segment.start, segments[0].start);
  EXPECT_EQ(lines[0].scale, 1.0F);
}

}  // namespace
}  // namespace point_line_odometry
