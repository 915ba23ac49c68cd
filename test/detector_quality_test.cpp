#include "benchmark/detector_quality.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace point_line_odometry {
namespace {

const QualityOptions kOptions;
const cv::Size kSize(400, 300);
const float kBlur = 0.7F * std::sqrt(2.0F);

struct Square {
  Eigen::Vector2f centre;
  float half = 0.0F;
  float angle_rad = 0.0F;

  Eigen::Vector2f axis(int quarter) const {
    const double angle = angle_rad + quarter * CV_PI / 2.0;
    return {static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle))};
  }
};

const std::vector<Square> kSquares = {
    {{90.0F, 85.0F}, 40.0F, 0.2F}, {{210.0F, 190.0F}, 55.0F, 0.7F}, {{310.0F, 80.0F}, 35.0F, 1.2F}};

/// Bright squares on a background of soft waves, with a lens blur of 0.7 px, all moved by `shift`.
cv::Mat squaresImage(const Eigen::Vector2f& shift) {
  cv::Mat image(kSize, CV_8UC1);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const Eigen::Vector2f p = Eigen::Vector2f(x, y) - shift;
      float grey = 70.0F + 10.0F * std::sin(0.21F * p.x() + 0.13F * p.y()) +
                   8.0F * std::sin(0.17F * p.y() - 0.09F * p.x());
      for (const Square& square : kSquares) {
        const Eigen::Vector2f d = p - square.centre;
        const float out =
            std::max(std::abs(d.dot(square.axis(0))), std::abs(d.dot(square.axis(1))));
        grey += 55.0F * (1.0F + std::erf((square.half - out) / kBlur));
      }
      image.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(grey);
    }
  }
  return image;
}

/// The sides of the squares without their corners, moved by `shift`.
std::vector<LineSegment> sides(const Eigen::Vector2f& shift) {
  std::vector<LineSegment> segments;
  for (const Square& square : kSquares) {
    for (int quarter = 0; quarter < 4; ++quarter) {
      const Eigen::Vector2f middle = square.centre + shift + square.half * square.axis(quarter);
      const Eigen::Vector2f along = (square.half - 6.0F) * square.axis(quarter + 1);
      segments.push_back({middle - along, middle + along});
    }
  }
  return segments;
}

std::vector<LineSegment> movedAcross(std::vector<LineSegment> segments, float by_px) {
  for (LineSegment& segment : segments) {
    const Eigen::Vector2f direction = segment.direction();
    const Eigen::Vector2f across = by_px * Eigen::Vector2f(-direction.y(), direction.x());
    segment = {segment.start + across, segment.end + across};
  }
  return segments;
}

std::vector<std::optional<LineSegment>> known(const std::vector<LineSegment>& segments) {
  return {segments.begin(), segments.end()};
}

/// Blurred noise, in which every position is distinctive.
cv::Mat noiseImage(int seed, cv::Size size) {
  cv::Mat noise(size, CV_8UC1);
  cv::RNG generator(static_cast<std::uint64_t>(seed));
  generator.fill(noise, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(noise, noise, cv::Size(0, 0), 1.5);
  cv::normalize(noise, noise, 0, 255, cv::NORM_MINMAX);
  return noise;
}

TEST(TrackSegments, FollowsAKnownShift) {
  const Eigen::Vector2f shift(7.3F, -2.6F);
  const std::vector<LineSegment> before = sides({0.0F, 0.0F});
  const std::vector<LineSegment> after = sides(shift);
  const auto tracked = trackSegments(TrackingImage(squaresImage({0.0F, 0.0F})),
                                     TrackingImage(squaresImage(shift)), before);
  ASSERT_EQ(tracked.size(), before.size());
  for (std::size_t i = 0; i < before.size(); ++i) {
    ASSERT_TRUE(tracked[i].has_value()) << i;
    const Eigen::Vector2f direction = after[i].direction();
    const Eigen::Vector2f normal(-direction.y(), direction.x());
    EXPECT_NEAR(normal.dot(tracked[i]->start - after[i].start), 0.0F, 0.15F) << i;
    EXPECT_NEAR(normal.dot(tracked[i]->end - after[i].end), 0.0F, 0.15F) << i;
    EXPECT_NEAR(direction.dot(tracked[i]->start - after[i].start), 0.0F, 3.0F) << i;
    EXPECT_NEAR(direction.dot(tracked[i]->end - after[i].end), 0.0F, 3.0F) << i;
  }
}

TEST(TrackSegments, WhatIsNotInTheOtherImageIsNotTracked) {
  const std::vector<LineSegment> segments = sides({0.0F, 0.0F});
  const auto tracked = trackSegments(TrackingImage(squaresImage({0.0F, 0.0F})),
                                     TrackingImage(noiseImage(1, kSize)), segments);
  const Repeatability result = measureRepeatability(tracked, segments, kOptions);
  EXPECT_EQ(result.total, segments.size());
  EXPECT_EQ(result.tracked, 0U);
  EXPECT_EQ(result.share(), 0.0);
}

TEST(TrackSegments, NoneOfNone) {
  const TrackingImage image(squaresImage({0.0F, 0.0F}));
  EXPECT_TRUE(trackSegments(image, image, {}).empty());
}

TEST(TrackSegments, LargeDisparitiesNeedAStart) {
  constexpr int kDisparity = 75;
  const cv::Mat wide = noiseImage(2, {kSize.width + kDisparity, kSize.height});
  const cv::Mat left = wide(cv::Rect(cv::Point(0, 0), kSize)).clone();
  const cv::Mat right = wide(cv::Rect(cv::Point(kDisparity, 0), kSize)).clone();
  std::vector<LineSegment> segments;
  std::vector<LineSegment> seen_right;
  for (int y = 40; y < 280; y += 40) {
    for (const float x : {240.0F, 300.0F}) {
      const auto v = static_cast<float>(y);
      segments.push_back({{x, v}, {x + 50.0F, v + 15.0F}});
      seen_right.push_back({{x - kDisparity, v}, {x - kDisparity + 50.0F, v + 15.0F}});
    }
  }
  const TrackingImage from(left);
  const TrackingImage to(right);
  const auto with = trackSegments(from, to, segments, startFromDisparity(left, right));
  const Repeatability result = measureRepeatability(with, seen_right, kOptions);
  EXPECT_EQ(result.tracked, segments.size());
  EXPECT_EQ(result.found, segments.size());
  EXPECT_EQ(measureRepeatability(trackSegments(from, to, segments), seen_right, kOptions).found,
            0U);
}

TEST(Repeatability, IsOneForAPerfectShift) {
  const Eigen::Vector2f shift(-9.0F, 4.4F);
  const auto tracked = trackSegments(TrackingImage(squaresImage({0.0F, 0.0F})),
                                     TrackingImage(squaresImage(shift)), sides({0.0F, 0.0F}));
  const Repeatability result = measureRepeatability(tracked, sides(shift), kOptions);
  EXPECT_EQ(result.trackedShare(), 1.0);
  EXPECT_EQ(result.share(), 1.0);
}

TEST(Repeatability, IsZeroForSegmentsElsewhere) {
  const std::vector<LineSegment> segments = sides({0.0F, 0.0F});
  EXPECT_EQ(measureRepeatability(known(segments), movedAcross(segments, 3.0F), kOptions).share(),
            0.0);
  EXPECT_EQ(measureRepeatability(known(segments), {}, kOptions).share(), 0.0);
}

TEST(Repeatability, CountsOnlyTrackedSegments) {
  const std::vector<LineSegment> segments = sides({0.0F, 0.0F});
  auto tracked = known(segments);
  tracked[1].reset();
  tracked[5].reset();
  Repeatability result =
      measureRepeatability(tracked, {segments.begin(), segments.begin() + 6}, kOptions);
  EXPECT_EQ(result.total, 12U);
  EXPECT_EQ(result.tracked, 10U);
  EXPECT_EQ(result.found, 4U);
  EXPECT_DOUBLE_EQ(result.share(), 0.4);
  EXPECT_DOUBLE_EQ(result.trackedShare(), 10.0 / 12.0);
  result.add({8, 5, 2});
  EXPECT_EQ(result.total, 20U);
  EXPECT_DOUBLE_EQ(result.share(), 0.4);
}

TEST(SameSegment, KeepsItsLimits) {
  const LineSegment a{{100.0F, 100.0F}, {200.0F, 100.0F}};
  const auto same = [&](const LineSegment& b) {
    EXPECT_EQ(sameSegment(a, b, kOptions), sameSegment(b, a, kOptions));
    return sameSegment(a, b, kOptions);
  };
  EXPECT_TRUE(same(a));
  EXPECT_TRUE(same({a.end, a.start})) << "the sense does not matter";
  EXPECT_TRUE(same({{100.0F, 101.9F}, {200.0F, 101.9F}}));
  EXPECT_FALSE(same({{100.0F, 102.1F}, {200.0F, 102.1F}})) << "too far along the normal";
  EXPECT_TRUE(same({{140.0F, 100.0F}, {160.0F, 101.7F}})) << "4.9 deg";
  EXPECT_FALSE(same({{140.0F, 100.0F}, {160.0F, 101.8F}})) << "5.1 deg";
  EXPECT_TRUE(same({{181.0F, 100.0F}, {219.0F, 100.0F}})) << "half of the shorter is enough";
  EXPECT_FALSE(same({{183.0F, 100.0F}, {221.0F, 100.0F}})) << "less than half of the shorter";
  EXPECT_FALSE(same({{210.0F, 100.0F}, {250.0F, 100.0F}})) << "beyond the end";
}

TEST(EdgeOffsets, AreZeroOnTheEdge) {
  const EdgeOffsets result =
      measureEdgeOffsets(smoothForEdges(squaresImage({0.3F, 0.8F})), sides({0.3F, 0.8F}), kOptions);
  EXPECT_GT(result.samples, 800U);
  EXPECT_EQ(result.edgeShare(), 1.0);
  EXPECT_LT(result.rms_px(), 0.06);
  EXPECT_LT(result.median_px(), 0.04);
}

TEST(EdgeOffsets, AreTheKnownOffset) {
  const cv::Mat smooth = smoothForEdges(squaresImage({0.0F, 0.0F}));
  for (const float offset : {-1.6F, -0.4F, 0.25F, 0.7F, 2.2F}) {
    const std::vector<LineSegment> segments = movedAcross(sides({0.0F, 0.0F}), offset);
    const EdgeOffsets result = measureEdgeOffsets(smooth, segments, kOptions);
    EXPECT_NEAR(result.rms_px(), std::abs(offset), 0.04) << offset;
    EXPECT_NEAR(result.median_px(), std::abs(offset), 0.04) << offset;
    ASSERT_FALSE(result.offsets_px.empty());
    const double sum = std::accumulate(result.offsets_px.begin(), result.offsets_px.end(), 0.0);
    EXPECT_NEAR(sum / static_cast<double>(result.offsets_px.size()), -offset, 0.04) << offset;
  }
}

TEST(EdgeOffsets, WhereThereIsNoEdgeNothingIsMeasured) {
  const EdgeOffsets flat = measureEdgeOffsets(
      smoothForEdges(cv::Mat(kSize, CV_8UC1, cv::Scalar(90))), sides({0.0F, 0.0F}), kOptions);
  EXPECT_GT(flat.samples, 800U);
  EXPECT_EQ(flat.edgeShare(), 0.0);
  EXPECT_EQ(flat.rms_px(), 0.0);
  EXPECT_EQ(flat.median_px(), 0.0);
  const EdgeOffsets far = measureEdgeOffsets(smoothForEdges(squaresImage({0.0F, 0.0F})),
                                             movedAcross(sides({0.0F, 0.0F}), 8.0F), kOptions);
  EXPECT_LT(far.edgeShare(), 0.3) << "the waves of the background are too weak";
}

TEST(EdgeOffsets, ThePolarityIsTheSegmentsOwn) {
  // A dark line 3 px wide: its two edges are of opposite sense.
  cv::Mat image(100, 100, CV_8UC1, cv::Scalar(180));
  image(cv::Rect(0, 50, 100, 3)) = 60;
  const std::vector<LineSegment> upper = {{{10.0F, 49.5F}, {90.0F, 49.5F}}};
  const std::vector<LineSegment> lower = {{{10.0F, 52.5F}, {90.0F, 52.5F}}};
  const cv::Mat smooth = smoothForEdges(image);
  EXPECT_LT(measureEdgeOffsets(smooth, upper, kOptions).rms_px(), 0.15);
  EXPECT_LT(measureEdgeOffsets(smooth, lower, kOptions).rms_px(), 0.15);
}

TEST(EdgeOffsets, NearTheBorderNothingIsMeasured) {
  const cv::Mat smooth = smoothForEdges(squaresImage({0.0F, 0.0F}));
  const std::vector<LineSegment> outside = {{{-50.0F, 10.0F}, {-5.0F, 80.0F}},
                                            {{10.0F, 1.0F}, {90.0F, 1.0F}},
                                            {{398.0F, 10.0F}, {398.0F, 90.0F}}};
  const EdgeOffsets result = measureEdgeOffsets(smooth, outside, kOptions);
  EXPECT_EQ(result.samples, 0U);
  EXPECT_EQ(result.edgeShare(), 0.0);
}

TEST(LongSegments, TheLongestFirst) {
  const std::vector<LineSegment> segments = {
      {{0.0F, 0.0F}, {20.0F, 0.0F}}, {{0.0F, 0.0F}, {0.0F, 21.0F}}, {{0.0F, 0.0F}, {30.0F, 40.0F}}};
  const std::vector<LineSegment> kept = longSegments(segments, kOptions);
  ASSERT_EQ(kept.size(), 2U);
  EXPECT_FLOAT_EQ(kept[0].length(), 50.0F);
  EXPECT_FLOAT_EQ(kept[1].length(), 21.0F);
  EXPECT_DOUBLE_EQ(totalLength_px(kept), 71.0);
}

}  // namespace
}  // namespace point_line_odometry
