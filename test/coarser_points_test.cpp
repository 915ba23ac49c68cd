
#include "odometry/coarser_points.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "common/cell_grid.h"
#include "features/stereo_feature_detector.h"
#include "matching/frame_matcher.h"
#include "odometry/correspondences.h"
#include "odometry/stereo_triangulation.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Vector2f;

constexpr int kWidth = 600;
constexpr int kHeight = 300;
constexpr int kDisparity = 16;

cv::Mat smoothNoise(cv::Size size, double sigma_px, double contrast, unsigned seed) {
  cv::Mat noise(size, CV_32FC1);
  cv::RNG(seed).fill(noise, cv::RNG::NORMAL, 0.0, 1.0);
  cv::GaussianBlur(noise, noise, {}, sigma_px);
  cv::normalize(noise, noise, 1.0, 0.0, cv::NORM_INF);
  return contrast * noise;
}

constexpr int kMaxShift = 60;

/// A wall in the dark, seen by both cameras with independent noise: blurred spots everywhere, and
/// sharp texture in columns up to `sharp_columns`. \param shift by which the spots lie farther to
/// the left; its noise is another one.
StereoImages wall(int sharp_columns, int shift = 0) {
  const cv::Size size(kWidth + kDisparity + kMaxShift, kHeight);
  cv::Mat brightness = smoothNoise(size, 5.0, 24.0, 1) + 40.0;
  cv::Mat sharp = smoothNoise(size, 1.2, 60.0, 2);
  if (sharp_columns > 0) brightness.colRange(0, sharp_columns) += sharp.colRange(0, sharp_columns);
  const auto camera = [&](int begin, int seed) {
    cv::Mat grain(kHeight, kWidth, CV_32FC1);
    cv::RNG(static_cast<unsigned>(seed)).fill(grain, cv::RNG::NORMAL, 0.0, 5.0);
    cv::Mat image;
    cv::Mat(brightness.colRange(begin, begin + kWidth) + grain).convertTo(image, CV_8UC1);
    return image;
  };
  return {camera(shift, 3 + 2 * shift), camera(shift + kDisparity, 4 + 2 * shift), 0};
}

/// A frame of the wall without and with coarser levels.
class CoarserPointsTest : public ::testing::Test {
 protected:
  struct Frames {
    StereoFrame finest;
    StereoFrame all;
    bool is_poor = false;
  };

  Frames framesOf(const StereoImages& images,
                  const std::optional<TrackingStart>& start = std::nullopt) {
    camera_.width = kWidth;
    camera_.height = kHeight;
    const StereoCorrection correction;
    FrameContext context{images, camera_, correction, parameters_};
    context.left.addLevels(parameters_.points);
    context.right.addLevels(parameters_.points);
    StereoFeatureDetector detector(parameters_.points, parameters_.lines);
    ThreadPool threads(2);
    Frames frames;
    frames.finest.left_image = context.left;
    frames.finest.features = detector.detect(images, LineResolution::kFull, &threads);
    triangulateMatches(
        matchStereo(frames.finest.features, correction, parameters_.matching, &threads), context,
        &threads, &frames.finest);
    const PointCoverage coverage(frames.finest, context);
    frames.is_poor = coverage.isPoor();
    frames.all = frames.finest;
    addCoarserPoints(&detector, start, coverage, context, &threads, &frames.all);
    return frames;
  }

  static const Keypoint& feature(const StereoFrame& frame, std::size_t point) {
    return frame.features.points_left[static_cast<std::size_t>(frame.points[point].left)];
  }

  /// Stereo points of a frame with a depth in the cell of a pixel.
  int numberInCell(const StereoFrame& frame, const Vector2f& pixel) const {
    const auto cell = [&](float coordinate) {
      return static_cast<int>(coordinate) / parameters_.points.cell_size_px;
    };
    int number = 0;
    for (std::size_t i = 0; i < frame.points.size(); ++i) {
      if (frame.points[i].far) continue;
      const Vector2f& other = feature(frame, i).pixel;
      number += cell(other.x()) == cell(pixel.x()) && cell(other.y()) == cell(pixel.y()) ? 1 : 0;
    }
    return number;
  }

  Parameters parameters_;
  StereoCamera camera_ = synthetic::camera();
};

TEST(CellGrid, HasNoCellsWithoutPixels) {
  EXPECT_EQ(CellGrid<int>(800, 600, 50).cells().size(), 16U * 12U);
  EXPECT_EQ(CellGrid<int>(801, 601, 50).cells().size(), 17U * 13U);
  CellGrid<int> grid(800, 600, 50);
  grid.at({799.4F, 599.4F}) = 1;
  EXPECT_EQ(grid.cells().back(), 1);
}

TEST_F(CoarserPointsTest, AreAddedOnlyWhereTheFrameHasFewPoints) {
  const Frames frames = framesOf(wall(150));
  EXPECT_TRUE(frames.is_poor);
  const std::size_t num_finest = frames.finest.points.size();
  ASSERT_GT(num_finest, 20U);
  ASSERT_GT(frames.all.points.size(), num_finest + 30U);
  for (std::size_t i = num_finest; i < frames.all.points.size(); ++i) {
    const Keypoint& point = feature(frames.all, i);
    EXPECT_GT(point.octave, 0);
    EXPECT_LT(numberInCell(frames.finest, point.pixel), 2) << point.pixel.transpose();
  }
}

TEST_F(CoarserPointsTest, LieOnTheWall) {
  const Frames frames = framesOf(wall(150));
  std::vector<double> errors_px;
  std::vector<double> by_sigma;
  for (std::size_t i = frames.finest.points.size(); i < frames.all.points.size(); ++i) {
    const StereoPoint& point = frames.all.points[i];
    const double disparity = feature(frames.all, i).pixel.x() - point.right_px.x();
    errors_px.push_back(std::abs(disparity - kDisparity));
    by_sigma.push_back(errors_px.back() / point.sigma_px);
    EXPECT_NEAR(point.triangulated.p_camera.z(), camera_.fx * camera_.baseline_m / disparity, 1e-3);
  }
  ASSERT_GT(errors_px.size(), 30U);
  const auto quantile = [](std::vector<double> values, double share) {
    std::sort(values.begin(), values.end());
    return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
  };
  EXPECT_LT(quantile(errors_px, 0.5), 0.5);
  EXPECT_LT(quantile(errors_px, 0.9), 1.0);  // a quarter of a pixel of the coarsest level
  EXPECT_LT(quantile(by_sigma, 0.68), 1.8);
}

TEST_F(CoarserPointsTest, LeaveThoseOfTheFinestLevelUnchanged) {
  const Frames frames = framesOf(wall(150));
  const std::size_t num_left = frames.finest.features.points_left.size();
  ASSERT_GT(frames.all.features.points_left.size(), num_left);
  for (std::size_t i = 0; i < num_left; ++i) {
    EXPECT_EQ(frames.all.features.points_left[i].pixel,
              frames.finest.features.points_left[i].pixel);
  }
  for (std::size_t i = 0; i < frames.finest.points.size(); ++i) {
    EXPECT_EQ(frames.all.points[i].left, frames.finest.points[i].left);
    EXPECT_EQ(frames.all.points[i].right, frames.finest.points[i].right);
    EXPECT_EQ(frames.all.points[i].right_px, frames.finest.points[i].right_px);
  }
}

TEST_F(CoarserPointsTest, AreNotNeededWhereTextureIsRich) {
  const Frames frames = framesOf(wall(kWidth + kDisparity));
  EXPECT_FALSE(frames.is_poor);
  EXPECT_GT(frames.finest.points.size(), 100U);
}

/// Points of a frame that were tracked from the previous one, and how many of them correctly.
struct Tracked {
  int number = 0;
  int correct = 0;
};

Tracked trackedOver(const StereoFrame& previous, const StereoFrame& curr, const Vector2f& shift) {
  Tracked tracked;
  for (const StereoPoint& now : curr.points) {
    const Keypoint& keypoint = curr.features.points_left[static_cast<std::size_t>(now.left)];
    for (const StereoPoint& point : previous.points) {
      const Keypoint& before = previous.features.points_left[static_cast<std::size_t>(point.left)];
      if (keypoint.descriptor != before.descriptor) continue;
      ++tracked.number;
      tracked.correct += (keypoint.pixel - before.pixel - shift).norm() < 2.0F ? 1 : 0;
    }
  }
  return tracked;
}

TEST_F(CoarserPointsTest, ArePredictedAndTracked) {
  constexpr int kShift = 40;
  const StereoFrame previous = framesOf(wall(0)).all;
  MotionPrediction prediction;  // 8 px too short
  prediction.T_curr_prev.translation().x() =
      -(kShift - 8) * camera_.baseline_m / static_cast<double>(kDisparity);
  const StereoFrame curr = framesOf(wall(0, kShift), TrackingStart{previous, prediction}).all;
  const Tracked tracked = trackedOver(previous, curr, Vector2f(-kShift, 0.0F));
  EXPECT_GT(tracked.number, 80);
  EXPECT_GT(tracked.correct, 9 * tracked.number / 10);
}

TEST_F(CoarserPointsTest, AreTrackedFarFromAWrongPrediction) {
  const StereoFrame previous = framesOf(wall(0)).all;
  const MotionPrediction wrong{Eigen::Isometry3d::Identity(), 10.0};
  const Vector2f shift(-kMaxShift, 0.0F);
  const StereoFrame wide = framesOf(wall(0, kMaxShift), TrackingStart{previous, wrong}).all;
  const Tracked far = trackedOver(previous, wide, shift);
  EXPECT_GT(far.number, 80);
  EXPECT_GT(far.correct, 9 * far.number / 10);
  parameters_.matching.wide_search = false;
  const StereoFrame near = framesOf(wall(0, kMaxShift), TrackingStart{previous, wrong}).all;
  EXPECT_LT(trackedOver(previous, near, shift).correct, 10);
}

TEST_F(CoarserPointsTest, AreNotNeededWhereFewPointsAreAskedFor) {
  parameters_.points.max_per_cell = 4;
  EXPECT_FALSE(framesOf(wall(kWidth + kDisparity)).is_poor);
  EXPECT_TRUE(framesOf(wall(150)).is_poor);
}

TEST_F(CoarserPointsTest, BlackImagesHaveNone) {
  const cv::Mat black(kHeight, kWidth, CV_8UC1, cv::Scalar(0));
  const Frames frames = framesOf({black, black, 0});
  EXPECT_TRUE(frames.is_poor);
  EXPECT_TRUE(frames.all.points.empty());
}

TEST_F(CoarserPointsTest, OneLevelHasNone) {
  parameters_.points.levels = 1;
  const Frames frames = framesOf(wall(150));
  EXPECT_EQ(frames.all.points.size(), frames.finest.points.size());
}

}  // namespace
}  // namespace point_line_odometry
