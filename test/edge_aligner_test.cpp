#include "features/edge_aligner.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "features/feature_mask.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/types.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Vector2f;

constexpr int kWidth = 160;
constexpr int kHeight = 120;

float distanceFrom(const LineSegment& edge, const Vector2f& pixel) {
  const Vector2f along = edge.direction();
  const Vector2f q = pixel - edge.start;
  return along.x() * q.y() - along.y() * q.x();  // positive on the right: the brighter side
}

/// A blurred step along an edge between a dark and a bright half, with noise.
cv::Mat stepAlong(const LineSegment& edge, double noise = 0.0, double contrast = 100.0) {
  synthetic::Random random(7);
  cv::Mat image(kHeight, kWidth, CV_8UC1);
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      const float d = distanceFrom(edge, Vector2f(static_cast<float>(u), static_cast<float>(v)));
      const double bright = 0.5 * (1.0 + std::erf(d / std::sqrt(2.0)));
      image.at<std::uint8_t>(v, u) =
          cv::saturate_cast<std::uint8_t>(60.0 + contrast * bright + random.normal(noise));
    }
  }
  return image;
}

/// A segment of 60 px through the middle of the image.
LineSegment edgeAt(double angle_deg) {
  const auto angle = static_cast<float>(angle_deg * M_PI / 180.0);
  const Vector2f middle(80.3F, 59.8F);
  const Vector2f half = 30.0F * Vector2f(std::cos(angle), std::sin(angle));
  return {middle - half, middle + half};
}

LineSegment shifted(const LineSegment& segment, float across_px, float turned_px = 0.0F) {
  const Vector2f along = segment.direction();
  const Vector2f normal(-along.y(), along.x());
  return {segment.start + (across_px - turned_px) * normal,
          segment.end + (across_px + turned_px) * normal};
}

std::optional<LineSegment> align(const cv::Mat& image, const LineSegment& predicted,
                                 const FeatureMask& mask = {}) {
  return alignEdge(image, mask, predicted, LineParameters());
}

TEST(EdgeAligner, FindsAnEdgeOfAnyDirection) {
  for (int angle_deg = 0; angle_deg < 360; angle_deg += 7) {
    const LineSegment edge = edgeAt(angle_deg);
    const cv::Mat image = stepAlong(edge);
    for (const float across_px : {-1.6F, 0.0F, 1.2F}) {
      const auto aligned = align(image, shifted(edge, across_px, 0.4F));
      ASSERT_TRUE(aligned) << angle_deg << " deg, " << across_px << " px";
      EXPECT_LT(std::abs(distanceFrom(edge, aligned->start)), 0.06F) << angle_deg;
      EXPECT_LT(std::abs(distanceFrom(edge, aligned->end)), 0.06F) << angle_deg;
      EXPECT_GT(aligned->direction().dot(edge.direction()), 0.999F) << angle_deg;
      EXPECT_NEAR(aligned->length(), edge.length(), 0.5F) << angle_deg;
    }
  }
}

TEST(EdgeAligner, AveragesNoise) {
  for (const double angle_deg : {3.0, 40.0, 93.0, 250.0}) {
    const LineSegment edge = edgeAt(angle_deg);
    const auto aligned = align(stepAlong(edge, 5.0), shifted(edge, 1.0F));
    ASSERT_TRUE(aligned) << angle_deg;
    EXPECT_LT(std::abs(distanceFrom(edge, aligned->start)), 0.25F) << angle_deg;
    EXPECT_LT(std::abs(distanceFrom(edge, aligned->end)), 0.25F) << angle_deg;
  }
}

TEST(EdgeAligner, TakesNoEdgeOfTheOtherPolarity) {
  const LineSegment edge = edgeAt(20.0);
  const cv::Mat image = stepAlong(edge);
  EXPECT_TRUE(align(image, edge));
  EXPECT_FALSE(align(image, {edge.end, edge.start}));
}

TEST(EdgeAligner, TakesNoOtherEdge) {
  const LineSegment edge = edgeAt(20.0);
  const cv::Mat image = stepAlong(edge);
  EXPECT_FALSE(align(image, shifted(edge, 6.0F))) << "too far away";
  EXPECT_FALSE(align(image, shifted(edge, 0.0F, 8.0F))) << "of another direction";
  EXPECT_FALSE(align(stepAlong(edge, 0.0, 4.0), edge)) << "below lines/min_gradient";
  EXPECT_FALSE(align(cv::Mat(kHeight, kWidth, CV_8UC1, cv::Scalar(90)), edge)) << "none";
}

TEST(EdgeAligner, NeedsMostOfTheSegment) {
  const LineSegment edge = edgeAt(0.0);
  const cv::Mat image = stepAlong(edge);
  const auto moved = [&](float u) {
    const Vector2f along(u, 0.0F);
    return LineSegment{edge.start + along, edge.end + along};
  };
  EXPECT_TRUE(align(image, moved(60.0F))) << "a third of it beyond the image";
  EXPECT_FALSE(align(image, moved(85.0F))) << "most of it";
  EXPECT_FALSE(align(image, moved(-1e6F)));
  EXPECT_FALSE(align(image, {edge.start, edge.start}));
  cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(255));
  mask.colRange(0, 66).setTo(0);
  EXPECT_TRUE(align(image, edge, FeatureMask(mask))) << "a quarter of it is masked";
  mask.colRange(0, 90).setTo(0);
  EXPECT_FALSE(align(image, edge, FeatureMask(mask))) << "most of it";
}

}  // namespace
}  // namespace point_line_odometry
