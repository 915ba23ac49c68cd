/// Vertical and horizontal disparities of a pair, measured without its calibration: rendered pairs,
/// correct and with each fault.

#include "checks/pair_check.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "checks/wide_matches.h"
#include "point_line_odometry/rectification.h"
#include "world/synthetic_world.h"

namespace point_line_odometry {
namespace {

/// A rectified pair of a scene, rendered once.
const StereoImages& scenePair(const std::string& scene) {
  static std::map<std::string, StereoImages> pairs;
  const auto found = pairs.find(scene);
  if (found != pairs.end()) return found->second;
  SyntheticWorldOptions options;
  options.scene = scene;
  const SyntheticWorld world(options);
  const StereoImages images = world.render(20);
  return pairs[scene] = world.needsRectification()
                            ? StereoRectifier(world.calibration()).rectify(images)
                            : images;
}

/// The image rotated about its centre, then shifted down.
cv::Mat moved(const cv::Mat& image, double down_px, double turn_deg = 0.0) {
  const cv::Point2f centre(0.5F * static_cast<float>(image.cols),
                           0.5F * static_cast<float>(image.rows));
  cv::Mat transform = cv::getRotationMatrix2D(centre, -turn_deg, 1.0);
  transform.at<double>(1, 2) += down_px;
  cv::Mat result;
  cv::warpAffine(image, result, transform, image.size(), cv::INTER_LINEAR, cv::BORDER_REFLECT);
  return result;
}

/// The first pair of a folder in KITTI's or EuRoC's layout; empty if there is none.
StereoImages firstPair(const std::filesystem::path& folder) {
  const auto first = [&](const char* kitti, const char* euroc) {
    std::filesystem::path images = folder / kitti;
    if (!std::filesystem::is_directory(images)) images = folder / "mav0" / euroc / "data";
    std::vector<std::string> names;
    std::error_code missing;
    for (const auto& entry : std::filesystem::directory_iterator(images, missing))
      names.push_back(entry.path().string());
    return names.empty()
               ? cv::Mat()
               : cv::imread(*std::min_element(names.begin(), names.end()), cv::IMREAD_GRAYSCALE);
  };
  return {first("image_0", "cam0"), first("image_1", "cam1"), 0};
}

/// Cameras without a fault: the doctor warns from a ratio of 1.42, and a share of 0.03, on.
TEST(RealPairs, AreOfTheSameBrightnessAndContrast) {
  const char* data = std::getenv("POINT_LINE_ODOMETRY_DATA");
  if (data == nullptr || !std::filesystem::is_directory(data)) {
    GTEST_SKIP() << "no data: set POINT_LINE_ODOMETRY_DATA to the folder of the sequences";
  }
  int count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(data)) {
    const StereoImages pair = firstPair(entry.path());
    if (pair.left.empty() || pair.right.empty()) continue;
    const PairMeasurement measurement = measurePair(pair.left, pair.right);
    std::cout << entry.path().filename() << ": " << measurement.brightness_ratio << ", "
              << measurement.matches << " matches\n";
    if (!measurement.valid()) continue;
    ++count;
    EXPECT_GT(measurement.brightness_ratio, 1.0 / 1.25) << entry.path();
    EXPECT_LT(measurement.brightness_ratio, 1.25) << entry.path();
    EXPECT_LT(measurement.obscured_left, 0.01) << entry.path();
    EXPECT_LT(measurement.obscured_right, 0.01) << entry.path();
  }
  EXPECT_GT(count, 2);
}

class PairCheckTest : public testing::TestWithParam<const char*> {
 protected:
  const StereoImages& pair() const { return scenePair(GetParam()); }
};

TEST_P(PairCheckTest, MeasuresTheBrightnessOfOneImageToTheOther) {
  EXPECT_NEAR(measurePair(pair().left, pair().right).brightness_ratio, 1.0, 0.1);
  cv::Mat darker;
  pair().right.convertTo(darker, -1, 0.5);
  EXPECT_NEAR(measurePair(pair().left, darker).brightness_ratio, 0.5, 0.05);
  EXPECT_NEAR(measurePair(darker, pair().left).brightness_ratio, 2.0, 0.2);
}

/// A large part of both images shows something that moves up and down with the robot, and not the
/// scene.
TEST_P(PairCheckTest, MaskedPartsAreLeftOut) {
  StereoImages images{pair().left.clone(), pair().right.clone(), 0};
  const int border = images.left.rows / 2;
  const cv::Mat lower = images.left.rowRange(border, images.left.rows).clone();
  moved(lower, 6.0).copyTo(images.right.rowRange(border, images.right.rows));
  cv::Mat mask(images.left.size(), CV_8UC1, cv::Scalar(255));
  mask.rowRange(border, mask.rows).setTo(0);
  const PairMeasurement with = measurePair(images.left, images.right, mask, mask);
  const PairMeasurement without = measurePair(images.left, images.right);
  EXPECT_GT(without.vertical_disparity_px, 2.0);
  EXPECT_LT(with.keypoints_left, without.keypoints_left);
  ASSERT_TRUE(with.valid());
  EXPECT_LT(with.vertical_disparity_px, 0.5);
  const cv::Mat nothing(images.left.size(), CV_8UC1, cv::Scalar(0));
  const PairMeasurement none = measurePair(images.left, images.right, nothing, nothing);
  EXPECT_EQ(none.keypoints_left, 0);
  EXPECT_FALSE(none.valid());
}

/// In no level of the pyramid.
TEST_P(PairCheckTest, NothingDependsOnMaskedPixels) {
  const cv::Mat image = pair().left;
  cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(255));
  const cv::Rect masked(image.cols / 3, image.rows / 3, image.cols / 3, image.rows / 3);
  mask(masked).setTo(0);
  cv::Mat changed = image.clone();
  cv::randu(changed(masked), 0, 256);
  const std::vector<Keypoint> as_it_is = detectUnmasked(image, mask);
  const std::vector<Keypoint> with_noise = detectUnmasked(changed, mask);
  ASSERT_EQ(as_it_is.size(), with_noise.size());
  EXPECT_GT(as_it_is.size(), 100U);
  for (std::size_t i = 0; i < as_it_is.size(); ++i) {
    EXPECT_EQ(as_it_is[i].pixel, with_noise[i].pixel) << i;
    EXPECT_EQ(as_it_is[i].descriptor, with_noise[i].descriptor) << i;
  }
}

TEST_P(PairCheckTest, ACorrectPairHasNoVerticalAndPositiveHorizontalDisparities) {
  const PairMeasurement m = measurePair(pair().left, pair().right);
  ASSERT_TRUE(m.valid()) << m.matches;
  EXPECT_LT(std::abs(m.row_offset_px), 0.2);
  EXPECT_LT(m.vertical_disparity_px, 0.4);
  EXPECT_GT(m.disparity_px, 2.0);
  EXPECT_LT(m.behind_infinity_share, 0.1);
  EXPECT_FALSE(m.identical);
  EXPECT_GT(m.contrast_left, 10.0);
  EXPECT_NEAR(m.contrast_left, m.contrast_right, 10.0);
}

TEST_P(PairCheckTest, MeasuresAVerticalShift) {
  for (const double down_px : {-45.0, -6.5, -1.75, 0.75, 3.0, 12.25, 50.0}) {
    SCOPED_TRACE(down_px);
    const PairMeasurement m = measurePair(pair().left, moved(pair().right, down_px));
    ASSERT_TRUE(m.valid()) << m.matches;
    EXPECT_NEAR(m.row_offset_px, down_px, 0.25);
    EXPECT_NEAR(m.vertical_disparity_px, std::abs(down_px), 0.3);
  }
}

TEST_P(PairCheckTest, MeasuresARotationThatTheMedianOffsetHides) {
  const double turn_deg = 2.0;
  const PairMeasurement m = measurePair(pair().left, moved(pair().right, 0.0, turn_deg));
  ASSERT_TRUE(m.valid()) << m.matches;
  EXPECT_GT(m.vertical_disparity_px, 1.5);
}

TEST_P(PairCheckTest, MeasuresHowMuchOfALensIsObscured) {
  const PairMeasurement clean = measurePair(pair().left, pair().right);
  EXPECT_LT(clean.obscured_left, 0.01);
  EXPECT_LT(clean.obscured_right, 0.01);
  StereoImages dirty = pair();
  dirty.right = pair().right.clone();
  const cv::Rect spot(dirty.right.cols / 4, dirty.right.rows / 3, dirty.right.cols / 3,
                      dirty.right.rows / 2);
  dirty.right(spot).setTo(30);
  const PairMeasurement covered = measurePair(dirty.left, dirty.right);
  EXPECT_LT(3.0 * covered.obscured_left, covered.obscured_right) << "the cover has an edge";
  EXPECT_GT(covered.obscured_right, 0.04);
  EXPECT_LT(covered.obscured_right, 0.17) << "more than is covered";
  dirty.right_mask = cv::Mat(dirty.right.size(), CV_8UC1, cv::Scalar(255));
  dirty.right_mask(spot).setTo(0);
  const PairMeasurement masked = measurePair(dirty.left, dirty.right, {}, dirty.right_mask);
  EXPECT_LT(masked.obscured_right, 0.01) << "what is masked is left out";
}

TEST_P(PairCheckTest, SwappedCamerasHaveNegativeDisparities) {
  const PairMeasurement usual = measurePair(pair().left, pair().right);
  const PairMeasurement m = measurePair(pair().right, pair().left);
  ASSERT_TRUE(m.valid()) << m.matches;
  EXPECT_NEAR(m.disparity_px, -usual.disparity_px, 1.0);
  EXPECT_GT(m.behind_infinity_share, 0.8);
  EXPECT_LT(m.vertical_disparity_px, 0.4);
}

TEST_P(PairCheckTest, OneCameraOnBothTopicsIsIdentical) {
  const PairMeasurement m = measurePair(pair().left, pair().left.clone());
  EXPECT_TRUE(m.identical);
  EXPECT_NEAR(m.disparity_px, 0.0, 1e-6);
}

TEST_P(PairCheckTest, FindsNothingInABlankImage) {
  const cv::Mat blank(pair().left.size(), CV_8UC1, cv::Scalar(90));
  for (const PairMeasurement& m :
       {measurePair(blank, pair().right), measurePair(pair().left, blank),
        measurePair(blank, blank.clone())}) {
    EXPECT_FALSE(m.valid());
    EXPECT_FALSE(m.identical) << "a covered lens is another fault";
    EXPECT_EQ(m.vertical_disparity_px, 0.0);
  }
  EXPECT_EQ(measurePair(blank, pair().right).keypoints_left, 0);
  EXPECT_LT(measurePair(blank, pair().right).contrast_left, 1e-3);
  EXPECT_GT(measurePair(blank, pair().right).keypoints_right, PairMeasurement::kFewestMatches);
}

INSTANTIATE_TEST_SUITE_P(Scenes, PairCheckTest, testing::Values("street", "indoor", "corridor"),
                         [](const auto& info) { return std::string(info.param); });

TEST(PairCheckOtherImagesTest, UnrelatedImagesHaveNoMatches) {
  const cv::Mat& street = scenePair("street").left;
  cv::Mat other;
  cv::resize(scenePair("indoor").right, other, street.size());
  EXPECT_FALSE(measurePair(street, other).valid());
  cv::Mat noise[2];
  for (cv::Mat& image : noise) image = cv::Mat(240, 320, CV_8UC1);
  cv::RNG random(3);
  for (cv::Mat& image : noise) random.fill(image, cv::RNG::UNIFORM, 0, 255);
  EXPECT_FALSE(measurePair(noise[0], noise[1]).valid());
}

TEST(PairCheckOtherImagesTest, RejectsOutliers) {
  const StereoImages& pair = scenePair("street");
  cv::Mat right = pair.right.clone();
  // A third of the view is displaced.
  pair.left(cv::Rect(400, 0, 400, 300)).copyTo(right(cv::Rect(460, 20, 400, 300)));
  const PairMeasurement m = measurePair(pair.left, right);
  ASSERT_TRUE(m.valid()) << m.matches;
  EXPECT_LT(m.behind_infinity_share, 0.1);
  EXPECT_LT(m.vertical_disparity_px, 0.4);
}

TEST(PairCheckOtherImagesTest, AcceptsAnyImage) {
  const cv::Mat& right = scenePair("corridor").right;
  const cv::Mat colour(right.size(), CV_8UC3, cv::Scalar(1, 2, 3));
  for (const cv::Mat& left : {cv::Mat(), colour, cv::Mat(1, 1, CV_8UC1, cv::Scalar(0))}) {
    EXPECT_FALSE(measurePair(left, right).valid());
    EXPECT_FALSE(measurePair(right, left).valid());
  }
  const cv::Mat half = right(cv::Rect(100, 100, 300, 200));
  EXPECT_NO_THROW(measurePair(half, right));
}

TEST(PairCheckOtherImagesTest, IsDeterministic) {
  const StereoImages& pair = scenePair("indoor");
  const PairMeasurement a = measurePair(pair.left, pair.right);
  const PairMeasurement b = measurePair(pair.left, pair.right);
  EXPECT_EQ(a.matches, b.matches);
  EXPECT_EQ(a.row_offset_px, b.row_offset_px);
  EXPECT_EQ(a.disparity_px, b.disparity_px);
}

}  // namespace
}  // namespace point_line_odometry
