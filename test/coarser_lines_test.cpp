#include "odometry/coarser_lines.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "matching/frame_matcher.h"
#include "motion/observations.h"
#include "odometry/stereo_triangulation.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

constexpr int kWidth = 600;
constexpr int kHeight = 400;
constexpr int kDisparity = 20;
constexpr int kTop = 50;
constexpr int kBottom = 350;

// The columns between which the bar lies in the left image.
constexpr int kLeft = 200;
constexpr int kRight = 260;

/// An upright, dark bar, seen by both cameras with independent noise.
/// \param contrast of the bar, \param noise of a pixel [grey levels].
StereoImages bar(double contrast, double noise) {
  const auto camera = [&](int shift, unsigned seed) {
    cv::Mat image(kHeight, kWidth, CV_32FC1, cv::Scalar(40.0));
    image(cv::Range(kTop, kBottom), cv::Range(kLeft - shift, kRight - shift)) -= contrast;
    cv::Mat grain(kHeight, kWidth, CV_32FC1);
    cv::RNG(seed).fill(grain, cv::RNG::NORMAL, 0.0, noise);
    cv::Mat bytes;
    cv::Mat(image + grain).convertTo(bytes, CV_8UC1);
    return bytes;
  };
  return {camera(0, 1), camera(kDisparity, 2), 0};
}

class CoarserLinesTest : public ::testing::Test {
 protected:
  CoarserLinesTest() {
    camera_.width = kWidth;
    camera_.height = kHeight;
  }

  FrameContext contextOf(const StereoImages& images) const {
    FrameContext context{images, camera_, correction_, parameters_};
    context.left.addLevels(parameters_.points);
    context.right.addLevels(parameters_.points);
    return context;
  }

  /// Lines of the image itself.
  StereoFrame finest(const FrameContext& context) {
    StereoFrame frame;
    StereoFeatureDetector detector(parameters_.points, parameters_.lines);
    frame.left_image = context.left;
    frame.features = detector.detect(context.images, LineResolution::kFull, &threads_);
    triangulateMatches(matchStereo(frame.features, correction_, parameters_.matching, &threads_),
                       context, &threads_, &frame);
    return frame;
  }

  void add(const FrameContext& context, StereoFrame* frame) {
    StereoFeatureDetector detector(parameters_.points, parameters_.lines);
    addCoarserLines(&detector, context, &threads_, frame);
  }

  /// Upright segments of the left image with a depth.
  static std::vector<LineFeature> upright(const StereoFrame& frame) {
    std::vector<LineFeature> features;
    for (const StereoLine& line : frame.lines) {
      const LineFeature& feature = frame.features.lines_left[static_cast<std::size_t>(line.left)];
      if (line.triangulated && std::abs(feature.segment.direction().x()) < 0.1F)
        features.push_back(feature);
    }
    return features;
  }

  Parameters parameters_;
  StereoCamera camera_ = synthetic::camera();
  StereoCorrection correction_;
  ThreadPool threads_{2};
};

TEST_F(CoarserLinesTest, AreFoundBelowTheNoiseOfAPixel) {
  const StereoImages images = bar(10.0, 7.0);
  const FrameContext context = contextOf(images);
  StereoFrame frame = finest(context);
  EXPECT_TRUE(upright(frame).empty());
  const std::size_t num_finest = frame.lines.size();
  add(context, &frame);
  EXPECT_GT(frame.lines.size(), num_finest);
  const std::vector<LineFeature> found = upright(frame);
  for (const int column : {kLeft, kRight}) {
    const auto at_edge = std::find_if(found.begin(), found.end(), [&](const LineFeature& line) {
      return std::abs(line.segment.middle().x() - (static_cast<float>(column) - 0.5F)) < 1.0F;
    });
    ASSERT_NE(at_edge, found.end()) << column;
    EXPECT_GT(at_edge->segment.length(), 0.4F * (kBottom - kTop)) << column;
  }
  const double depth_m = camera_.fx * camera_.baseline_m / kDisparity;
  for (const StereoLine& line : frame.lines) {
    if (!line.triangulated) continue;
    EXPECT_NEAR(line.triangulated->start_camera.z() / depth_m, 1.0, 0.1);
    const LineFeature& left = frame.features.lines_left[static_cast<std::size_t>(line.left)];
    EXPECT_NEAR(left.scale, 1.4 * 1.4 * 1.4, 0.05);
  }
}

TEST_F(CoarserLinesTest, AreWeightedByTheLevelsPixels) {
  const StereoImages images = bar(10.0, 7.0);
  const FrameContext context = contextOf(images);
  const LineSegment segment{{100.0F, 50.0F}, {100.0F, 150.0F}};
  const LineSegment at_level{{100.0F, 50.0F}, {100.0F, 100.0F}};
  EXPECT_DOUBLE_EQ(lineObservation(segment, segment, 2.0, context).sigma_px,
                   2.0 * lineObservation(at_level, at_level, 1.0, context).sigma_px);
}

/// In a bright image without noise the edges have lines already.
TEST_F(CoarserLinesTest, EdgesThatHaveALineAreNotAddedAgain) {
  const StereoImages images = bar(35.0, 0.0);
  const FrameContext context = contextOf(images);
  StereoFrame frame = finest(context);
  const std::size_t num_finest = frame.lines.size();
  EXPECT_EQ(upright(frame).size(), 2U);
  add(context, &frame);
  EXPECT_EQ(frame.lines.size(), num_finest);
}

TEST_F(CoarserLinesTest, NoneWithoutACoarserLevelOrWithoutLines) {
  const StereoImages images = bar(10.0, 7.0);
  const auto numAdded = [&] {
    const FrameContext context = contextOf(images);
    StereoFrame frame;
    add(context, &frame);
    return frame.lines.size();
  };
  EXPECT_GT(numAdded(), 1U);
  parameters_.points.levels = 1;
  EXPECT_EQ(numAdded(), 0U);
  parameters_.points = PointParameters();
  parameters_.lines.enabled = false;
  EXPECT_EQ(numAdded(), 0U);
}

TEST_F(CoarserLinesTest, AnImageHasNoMoreThanTheMostLines) {
  const StereoImages images = bar(10.0, 7.0);
  parameters_.lines.max_count = 1;
  const FrameContext context = contextOf(images);
  StereoFrame frame;
  add(context, &frame);
  EXPECT_EQ(frame.features.lines_left.size(), 1U);
  EXPECT_EQ(frame.features.lines_right.size(), 1U);
  frame.features.lines_left.resize(2);
  add(context, &frame);
  EXPECT_EQ(frame.features.lines_left.size(), 2U);
}

TEST_F(CoarserLinesTest, MaskedEdgesAreNotFound) {
  constexpr int kMasked = 230;
  const StereoImages images = bar(10.0, 7.0);
  cv::Mat mask(kHeight, kWidth, CV_8UC1, cv::Scalar(1));
  mask.colRange(kMasked, kWidth) = cv::Scalar(0);
  FrameContext context = contextOf(images);
  context.masks.left = FeatureMask(mask);
  context.masks.right = FeatureMask(mask);
  context.masks.left.addLevels(context.left);
  context.masks.right.addLevels(context.right);
  StereoFrame frame;
  add(context, &frame);
  EXPECT_FALSE(frame.features.lines_left.empty());
  for (const LineFeature& line : frame.features.lines_left) {
    EXPECT_LT(line.segment.start.x(), kMasked);
    EXPECT_LT(line.segment.end.x(), kMasked);
  }
}

}  // namespace
}  // namespace point_line_odometry
