#include "features/feature_mask.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>
#include <string>

#include "features/lsd_detector.h"
#include "features/stereo_feature_detector.h"
#include "matching/correlation_matcher.h"
#include "odometry/image_scaling.h"
#include "point_line_odometry/feature_overlay.h"
#include "point_line_odometry/stereo_odometry.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Vector2f;

const StereoCamera kCamera = synthetic::roomCamera();
const cv::Size kSize(kCamera.width, kCamera.height);
const cv::Rect kMasked(150, 90, 110, 190);  // in the lower middle of the image

cv::Mat maskOf(const cv::Rect& masked, cv::Size size = kSize) {
  cv::Mat mask(size, CV_8UC1, cv::Scalar(1));
  mask(masked) = cv::Scalar(0);
  return mask;
}

StereoImages masked(StereoImages images, const cv::Rect& where) {
  images.left_mask = maskOf(where, images.left.size());
  images.right_mask = images.left_mask;
  return images;
}

/// Other pixels at random in a place.
StereoImages spoilt(StereoImages images, const cv::Rect& where, int seed) {
  for (cv::Mat* image : {&images.left, &images.right}) {
    *image = image->clone();
    cv::Mat part = (*image)(where);
    cv::RNG(static_cast<unsigned>(seed)).fill(part, cv::RNG::UNIFORM, 0, 256);
    cv::GaussianBlur(part, part, {}, 1.0);
  }
  return images;
}

cv::Rect grown(const cv::Rect& rect, int margin) {
  return {rect.x - margin, rect.y - margin, rect.width + 2 * margin, rect.height + 2 * margin};
}

/// A pixel is in a rectangle.
bool isIn(const cv::Rect& rect, const Vector2f& pixel) {
  return rect.contains(cv::Point(cvRound(pixel.x()), cvRound(pixel.y())));
}

bool touches(const cv::Rect& rect, const LineSegment& segment) {
  const int steps = 4 * static_cast<int>(segment.length()) + 1;
  for (int i = 0; i <= steps; ++i) {
    const float t = static_cast<float>(i) / static_cast<float>(steps);
    if (isIn(rect, segment.start + t * (segment.end - segment.start))) return true;
  }
  return false;
}

cv::Mat texture(cv::Size size, double sigma_px, unsigned seed) {
  cv::Mat noise(size, CV_32FC1);
  cv::RNG(seed).fill(noise, cv::RNG::NORMAL, 0.0, 1.0);
  cv::GaussianBlur(noise, noise, {}, sigma_px);
  cv::normalize(noise, noise, 100.0, 0.0, cv::NORM_INF);
  cv::Mat image;
  noise.convertTo(image, CV_8UC1, 1.0, 128.0);
  return image;
}

TEST(FeatureMask, NothingIsMaskedWithoutZeros) {
  EXPECT_TRUE(FeatureMask().empty());
  EXPECT_TRUE(FeatureMask(cv::Mat()).empty());
  EXPECT_TRUE(FeatureMask(cv::Mat(kSize, CV_8UC1, cv::Scalar(1))).empty());
  const FeatureMask mask;
  const cv::Mat image = synthetic::frame(0).left;
  EXPECT_EQ(mask.paint(image).data, image.data);
  EXPECT_TRUE(mask.allowsPatch({3.0F, 3.0F}, 4));
  EXPECT_EQ(mask.share(), 0.0);
}

TEST(FeatureMask, KeepsDistanceToMaskedPixels) {
  const FeatureMask mask(maskOf(kMasked));
  EXPECT_NEAR(mask.share(), static_cast<double>(kMasked.area()) / kSize.area(), 1e-9);
  for (const auto& [allowed, margin] : {std::make_pair(mask.points(), FeatureMask::kPointMargin),
                                        std::make_pair(mask.edges(), FeatureMask::kEdgeMargin)}) {
    EXPECT_EQ(cv::countNonZero(allowed(grown(kMasked, margin) & cv::Rect({0, 0}, kSize))), 0);
    EXPECT_EQ(allowed.at<uchar>(kMasked.y - margin - 1, kMasked.x), 255);
    EXPECT_EQ(allowed.at<uchar>(0, 0), 255);
  }
  const auto row = static_cast<float>(kMasked.y);
  const auto column = static_cast<float>(kMasked.x - FeatureMask::kPatchMargin);
  EXPECT_FALSE(mask.allowsPatch({column, row}, 0));
  EXPECT_TRUE(mask.allowsPatch({column - 1.0F, row}, 0));
  EXPECT_FALSE(mask.allowsPatch({-5.0F, row}, 0));
}

TEST(FeatureMask, ALevelsPixelIsMaskedIfOneOfItsPixelsIs) {
  const PointParameters parameters;
  const ImagePyramid pyramid(synthetic::frame(0).left, parameters);
  const cv::Rect one_pixel(200, 100, 1, 1);
  FeatureMask mask(maskOf(one_pixel));
  mask.addLevels(pyramid);
  for (std::size_t level = 0; level < pyramid.levels.size(); ++level) {
    const auto octave = static_cast<int>(level);
    const Vector2f at = pyramid.toLevel({200.0F, 100.0F}, octave);
    constexpr float kMargin = FeatureMask::kPatchMargin;
    EXPECT_FALSE(mask.allowsPatch(at, octave)) << level;
    EXPECT_FALSE(mask.allowsPatch(at - Vector2f(kMargin - 0.5F, 0.0F), octave)) << level;
    EXPECT_TRUE(mask.allowsPatch(at - Vector2f(kMargin + 2.0F, 0.0F), octave)) << level;
  }
}

/// A mask that stays is reduced for the first frame alone.
TEST(FeatureMask, CopiesShareTheLevelsThatAreAdded) {
  const ImagePyramid pyramid(synthetic::frame(0).left, PointParameters());
  const FeatureMask kept(maskOf(kMasked));
  FeatureMask of_frame = kept;
  of_frame.addLevels(pyramid);
  ASSERT_TRUE(kept.allowsPatch(pyramid.toLevel({300.0F, 200.0F}, 1), 1));
  for (int octave = 1; octave < static_cast<int>(pyramid.levels.size()); ++octave) {
    EXPECT_EQ(&kept.ofLevel(octave), &of_frame.ofLevel(octave));
    EXPECT_EQ(kept.ofLevel(octave).edges().size(),
              pyramid.levels[static_cast<std::size_t>(octave)].size());
  }
}

TEST(FeatureMask, SegmentsAreCut) {
  const FeatureMask mask(maskOf({100, 0, 3, 280}));
  const LineSegment far{{10.0F, 20.0F}, {10.0F, 200.0F}};
  const LineSegment crossing{{40.0F, 50.0F}, {190.0F, 50.0F}};
  const LineSegment within{{102.0F, 20.0F}, {102.0F, 200.0F}};
  const LineSegment short_rest{{80.0F, 90.0F}, {120.0F, 90.0F}};
  std::vector<LineSegment> segments{far, crossing, within, short_rest};
  mask.cut(20.0, &segments);
  ASSERT_EQ(segments.size(), 2U);
  EXPECT_EQ(segments[0].start, far.start);
  EXPECT_EQ(segments[0].end, far.end);
  EXPECT_NEAR(segments[1].start.x(), 103 + FeatureMask::kEdgeMargin, 1.0);
  EXPECT_EQ(segments[1].end, crossing.end);
  EXPECT_EQ(segments[1].start.y(), 50.0F);
  EXPECT_TRUE(mask.hides(within));
  EXPECT_FALSE(mask.hides(crossing));
}

TEST(FeatureMask, NoKeypointNearMaskedPixelsInAnyLevel) {
  const cv::Mat image = texture(kSize, 3.0, 5);
  for (const char* descriptor : {"brief", "orb"}) {
    PointParameters parameters;
    parameters.descriptor = descriptor;
    PointDetector detector(parameters);
    FeatureMask mask(maskOf(kMasked));
    const ImagePyramid pyramid(mask.paint(image), parameters);
    mask.addLevels(pyramid);
    std::vector<Keypoint> points = detector.detectFinest(pyramid.levels.front(), mask);
    EXPECT_GT(points.size(), 100U);
    for (const Keypoint& point : points)
      EXPECT_FALSE(isIn(grown(kMasked, FeatureMask::kPointMargin), point.pixel));
    points = detector.detectCoarser(pyramid, nullptr, mask);
    EXPECT_GT(points.size(), 20U);
    for (const Keypoint& point : points) {
      const auto margin =
          static_cast<int>(FeatureMask::kPatchMargin * pyramid.ratio(point.octave).minCoeff());
      EXPECT_FALSE(isIn(grown(kMasked, margin - 1), point.pixel)) << point.octave;
    }
  }
}

/// A mask takes no corner of a cell's number: those beside it are as strong as without it.
TEST(FeatureMask, CornersThatAreMaskedTakeNoPlaceInTheirCell) {
  const cv::Mat image = texture(kSize, 1.5, 6);
  PointParameters parameters;
  parameters.cell_size_px = 400;  // one cell
  parameters.max_per_cell = 50;
  const FeatureMask mask(maskOf(kMasked));
  const std::vector<Keypoint> points =
      PointDetector(parameters).detectFinest(mask.paint(image), mask);
  EXPECT_EQ(points.size(), 50U);
}

TEST(FeatureMask, NoSegmentTouchesMaskedPixels) {
  for (const char* detector : {"edge_chains", "lsd"}) {
    LineParameters lines;
    lines.detector = detector;
    if (std::string(detector) == "lsd" && !LsdDetector::isAvailable()) continue;
    StereoFeatureDetector both({}, lines);
    ThreadPool threads(1);
    StereoImages images = synthetic::frame(0);
    const std::size_t without =
        both.detect(images, LineResolution::kFull, &threads).lines_left.size();
    const FeatureMask mask(maskOf(kMasked));
    images.left = mask.paint(images.left);
    images.right = mask.paint(images.right);
    const DetectedFeatures found =
        both.detect(images, LineResolution::kFull, &threads, {mask, mask});
    EXPECT_GT(found.lines_left.size(), without / 3) << detector;
    EXPECT_LT(found.lines_left.size(), without) << detector;
    for (const auto* lines_found : {&found.lines_left, &found.lines_right}) {
      for (const LineFeature& line : *lines_found)
        EXPECT_FALSE(touches(grown(kMasked, FeatureMask::kEdgeMargin - 1), line.segment))
            << detector;
    }
  }
}

/// A segment ends before the masked place, and the rest of the edge is found.
TEST(FeatureMask, AnEdgeIsCutNotLost) {
  StereoImages images;
  images.left = cv::Mat(kSize, CV_8UC1, cv::Scalar(60));
  images.left.rowRange(200, kSize.height) = cv::Scalar(180);
  images.right = images.left;
  const FeatureMask mask(maskOf({300, 100, 100, 180}));
  images.left = mask.paint(images.left);
  StereoFeatureDetector detector({}, {});
  ThreadPool threads(1);
  const DetectedFeatures found =
      detector.detect(images, LineResolution::kFull, &threads, {mask, {}});
  ASSERT_EQ(found.lines_left.size(), 1U);
  EXPECT_NEAR(found.lines_left[0].segment.length(), 300.0F - FeatureMask::kEdgeMargin, 4.0F);
  ASSERT_EQ(found.lines_right.size(), 1U);
  EXPECT_GT(found.lines_right[0].segment.length(), 390.0F);
}

/// Found where the right image shows it, unless that is masked.
TEST(FeatureMask, CorrelationFindsNothingInAMaskedPlace) {
  constexpr int kShift = 24;
  const cv::Mat wide = texture({kSize.width + kShift, kSize.height}, 4.0, 7);
  const PointParameters parameters;
  const ImagePyramid left(wide.colRange(0, kSize.width).clone(), parameters);
  const ImagePyramid right(wide.colRange(kShift, kSize.width + kShift).clone(), parameters);
  ThreadPool threads(2);
  const std::vector<Keypoint> corners = PointDetector(parameters).detectCoarser(left);
  StereoMasks masks;
  const auto match = [&] {
    return matchStereoByCorrelation(corners, left, right, masks, {}, &threads);
  };
  const auto unmasked = match();
  masks.right = FeatureMask(maskOf(kMasked));
  masks.right.addLevels(right);
  const auto found = match();
  int ended = 0;
  int stayed = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (!unmasked[i]) continue;
    const int octave = corners[i].octave;
    if (masks.right.allowsPatch(right.toLevel(*unmasked[i], octave), octave)) {
      stayed += found[i].has_value() ? 1 : 0;
      continue;
    }
    EXPECT_FALSE(found[i].has_value());
    ++ended;
  }
  EXPECT_GT(ended, 5);
  EXPECT_GT(stayed, 5);
}

StereoImages uniform(const cv::Size& size) {
  return {cv::Mat(size, CV_8UC1, cv::Scalar(9)), cv::Mat(size, CV_8UC1, cv::Scalar(9)), 1};
}

TEST(FeatureMask, AReducedPixelThatTouchesAnIgnoredOneIsIgnored) {
  StereoCamera camera = kCamera;
  camera.width = 1600;
  camera.height = 1201;
  const ImageScaling scaling(camera, {});
  StereoImages images = uniform({1600, 1201});
  images.left_mask = maskOf({801, 600, 1, 1}, {1600, 1201});
  const StereoImages small = scaling.scale(images);
  EXPECT_EQ(small.left_mask.size(), small.left.size());
  EXPECT_EQ(small.left_mask.at<uchar>(300, 400), 0);
  EXPECT_EQ(cv::countNonZero(small.left_mask), static_cast<int>(small.left_mask.total()) - 1);
  EXPECT_TRUE(small.right_mask.empty());
}

TEST(FeatureMask, EnlargedPixelsDoNotDependOnIgnoredOnes) {
  StereoCamera camera = kCamera;
  camera.width = 40;
  camera.height = 30;
  TrackingParameters parameters;
  parameters.min_megapixels = 0.01;
  const ImageScaling scaling(camera, parameters);
  ASSERT_EQ(scaling.camera().width, 120);
  StereoImages images = uniform({40, 30});
  images.left_mask = maskOf({12, 9, 5, 4}, {40, 30});
  const StereoImages large = scaling.scale(images);
  ASSERT_EQ(large.left_mask.size(), large.left.size());
  EXPECT_EQ(cv::countNonZero(large.left_mask == 0), (5 + 4) * (4 + 4) * 3 * 3);
  images.left(cv::Rect(12, 9, 5, 4)).setTo(250);
  const cv::Mat differs = scaling.scale(images).left != large.left;
  EXPECT_GT(cv::countNonZero(differs), 0);
  EXPECT_EQ(cv::countNonZero(differs & large.left_mask), 0);
}

TEST(FeatureMask, TheSameMaskIsMadeOnce) {
  StereoMaskCache cache;
  StereoImages images = masked(synthetic::frame(0), kMasked);
  const uchar* made = cache.of(images).left.points().data;
  images.left_mask = images.left_mask.clone();
  EXPECT_EQ(cache.of(images).left.points().data, made);
  images.left_mask.at<uchar>(0, 0) = 0;
  EXPECT_EQ(cache.of(images).left.points().at<uchar>(5, 5), 0);
  images.left_mask = cv::Mat();
  EXPECT_TRUE(cache.of(images).left.empty());
  EXPECT_FALSE(cache.of(images).right.empty());
}

// --- The whole odometry

struct Drive {
  std::vector<FrameResult> results;
  std::string state;
};

template <typename Frame>
Drive drive(const Frame& frame, const Parameters& parameters = synthetic::roomParameters()) {
  StereoOdometry odometry(kCamera, parameters);
  Drive drive;
  for (int k = 0; k < synthetic::kFrames; ++k) drive.results.push_back(odometry.process(frame(k)));
  drive.state = odometry.saveState();
  return drive;
}

/// The state has all features, landmarks and images that remain from a frame.
TEST(MaskedOdometry, NoBitDependsOnMaskedPixels) {
  Parameters dark = synthetic::roomParameters();
  dark.points.fast_threshold = 100;  // so that points of coarser levels are used
  for (const Parameters& parameters : {synthetic::roomParameters(), dark, Parameters()}) {
    const auto clean = [](int k) { return masked(synthetic::frame(k), kMasked); };
    const Drive plain = drive(clean, parameters);
    const Drive other = drive([&](int k) { return spoilt(clean(k), kMasked, k + 1); }, parameters);
    EXPECT_TRUE(plain.state == other.state);
    for (int k = 0; k < synthetic::kFrames; ++k) {
      EXPECT_EQ(plain.results[k].T_odom_camera.matrix(), other.results[k].T_odom_camera.matrix());
      EXPECT_EQ(plain.results[k].counts.points_left, other.results[k].counts.points_left);
    }
  }
}

TEST(MaskedOdometry, NothingIsFoundInAMaskedPlace) {
  const Drive all = drive([](int k) { return masked(synthetic::frame(k), kMasked); });
  for (const FrameResult& result : all.results) {
    if (result.reason == TrackingReason::kFirstFrame) continue;
    EXPECT_EQ(result.state, TrackingState::kOk);
    for (const ObservedPoint& point : result.points) {
      EXPECT_FALSE(isIn(kMasked, point.left_px) || isIn(kMasked, point.right_px));
    }
    for (const ObservedLine& line : result.lines)
      EXPECT_FALSE(touches(kMasked, line.left_px) || touches(kMasked, line.right_px));
    for (const Vector2f& pixel : result.unmatched_points_px) EXPECT_FALSE(isIn(kMasked, pixel));
    for (const LineSegment& line : result.unmatched_lines_px) EXPECT_FALSE(touches(kMasked, line));
  }
}

/// What is at rest in the picture, with most of the features, stops the odometry; not if masked.
TEST(MaskedOdometry, WhatMovesWithTheCameraIsNoMotion) {
  const cv::Rect body(0, 60, kSize.width, 220);
  const auto withBody = [&](int k) {
    StereoImages images = synthetic::frame(k);
    images.left = images.left.clone();
    images.right = images.right.clone();
    constexpr int kDisparity = 30;
    const cv::Mat paint = texture({body.width + kDisparity, body.height}, 1.5, 9);
    paint.colRange(0, body.width).copyTo(images.left(body));
    paint.colRange(kDisparity, kDisparity + body.width).copyTo(images.right(body));
    return images;
  };
  const auto error = [](const Drive& drive) {
    return (drive.results.back().T_odom_camera.translation() -
            synthetic::truePose(synthetic::kFrames - 1).translation())
        .norm();
  };
  EXPECT_GT(error(drive(withBody)), 0.2);
  EXPECT_LT(error(drive([&](int k) { return masked(withBody(k), body); })), 0.03);
}

TEST(MaskedOdometry, AMaskWithoutZerosChangesNothing) {
  const Drive without = drive([](int k) { return synthetic::frame(k); });
  const Drive with = drive([](int k) {
    StereoImages images = synthetic::frame(k);
    images.left_mask = images.right_mask = cv::Mat(kSize, CV_8UC1, cv::Scalar(1));
    return images;
  });
  EXPECT_TRUE(without.state == with.state);
}

/// Masks of their own for each frame: a track ends where it enters a masked place, and landmarks
/// that come out of it again are found again.
TEST(MaskedOdometry, AMaskMayComeAndGo) {
  const Drive passing = drive([](int k) {
    return k == 3 || k == 4 ? masked(synthetic::frame(k), kMasked) : synthetic::frame(k);
  });
  const Drive never = drive([](int k) { return synthetic::frame(k); });
  for (const int k : {3, 4}) {
    for (const ObservedPoint& point : passing.results[k].points)
      EXPECT_FALSE(isIn(kMasked, point.left_px));
    EXPECT_LT(passing.results[k].counts.map_point_inliers,
              never.results[k].counts.map_point_inliers);
  }
  EXPECT_GT(passing.results[5].counts.map_point_inliers,
            0.9 * never.results[5].counts.map_point_inliers);
  EXPECT_EQ(passing.results.back().state, TrackingState::kOk);
}

TEST(MaskedOdometry, EverythingMaskedIsAFrameWithoutFeatures) {
  const cv::Rect all({0, 0}, kSize);
  const Drive blind = drive([&](int k) { return masked(synthetic::frame(k), all); });
  EXPECT_EQ(blind.results.back().counts.points_left, 0);
  EXPECT_EQ(blind.results.back().counts.lines_left, 0);
  EXPECT_TRUE(blind.results.back().T_odom_camera.matrix().allFinite());
}

TEST(MaskedOdometry, MasksOfTheWrongSizeOrTypeAreRefused) {
  for (const cv::Mat& bad : {cv::Mat(kSize.height, kSize.width - 1, CV_8UC1, cv::Scalar(1)),
                             cv::Mat(kSize, CV_8UC3, cv::Scalar::all(1))}) {
    StereoOdometry odometry(kCamera, {});
    StereoImages images = synthetic::frame(0);
    images.right_mask = bad;
    EXPECT_EQ(odometry.process(images).reason, TrackingReason::kWrongImages);
    images.right_mask = cv::Mat();
    EXPECT_TRUE(odometry.process(images).accepted());
  }
}

TEST(MaskedOdometry, TheOverlayIsDimmedThere) {
  const cv::Mat grey(kSize, CV_8UC1, cv::Scalar(200));
  const cv::Mat drawn = drawFeatures(grey, {}, maskOf(kMasked));
  EXPECT_EQ(drawn.at<cv::Vec3b>(kMasked.y + 5, kMasked.x + 5), cv::Vec3b(70, 70, 70));
  EXPECT_EQ(drawn.at<cv::Vec3b>(kMasked.y - 5, kMasked.x + 5), cv::Vec3b(200, 200, 200));
}

}  // namespace
}  // namespace point_line_odometry
