
#include "world/synthetic_world.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <tuple>
#include <vector>

#include "world/sensor.h"

namespace point_line_odometry {
namespace {

SyntheticWorldOptions quiet(const std::string& scene, int seed = 3) {
  SyntheticWorldOptions options;
  options.scene = scene;
  options.seed = seed;
  options.noise = 0.0;
  return options;
}

double difference(const cv::Mat& a, const cv::Mat& b) { return cv::norm(a, b, cv::NORM_INF); }

class EveryScene : public testing::TestWithParam<const char*> {};

TEST_P(EveryScene, SameOptionsGiveTheSameBytesInAnyOrder) {
  SyntheticWorldOptions options = quiet(GetParam());
  options.noise = 2.0;
  const SyntheticWorld a(options);
  const SyntheticWorld b(options);
  const StereoImages late = a.render(17);
  a.render(4);
  b.render(4);
  const StereoImages again = b.render(17);
  EXPECT_EQ(difference(late.left, again.left), 0.0);
  EXPECT_EQ(difference(late.right, again.right), 0.0);
}

TEST_P(EveryScene, SeedsGiveDifferentWorlds) {
  const cv::Mat a = SyntheticWorld(quiet(GetParam(), 1)).render(0).left;
  const cv::Mat b = SyntheticWorld(quiet(GetParam(), 2)).render(0).left;
  EXPECT_GT(cv::norm(a, b, cv::NORM_L1) / static_cast<double>(a.total()), 5.0);
}

TEST_P(EveryScene, ImagesFitTheCalibrationAndAreWellExposed) {
  const SyntheticWorld world(quiet(GetParam()));
  const bool dark = std::string(GetParam()) == "plaster";
  for (const std::size_t frame : {0U, 60U, 120U}) {
    const StereoImages images = world.render(frame);
    for (const cv::Mat& image : {images.left, images.right}) {
      EXPECT_EQ(image.type(), CV_8UC1);
      EXPECT_EQ(image.cols, world.calibration().left.width);
      EXPECT_EQ(image.rows, world.calibration().left.height);
      EXPECT_GT(cv::mean(image)[0], dark ? 40.0 : 50.0);
      EXPECT_LT(cv::mean(image)[0], 190.0);
      EXPECT_LT(cv::countNonZero(image == 255), 0.05 * static_cast<double>(image.total()));
    }
    EXPECT_EQ(images.stamp_ns, world.pose(frame).stamp_ns);
  }
  EXPECT_NO_THROW(rectifiedCamera(world.calibration()).validate());
}

TEST_P(EveryScene, FirstPoseIsIdentityAndStampsFollowTheFrameRate) {
  SyntheticWorldOptions options = quiet(GetParam());
  options.frame_rate_hz = 40.0;
  const SyntheticWorld world(options);
  EXPECT_TRUE(world.pose(0).T_world_camera.isApprox(Eigen::Isometry3d::Identity(), 1e-12));
  EXPECT_EQ(world.pose(0).stamp_ns, 0);
  EXPECT_EQ(world.pose(3).stamp_ns, 75000000);
  EXPECT_EQ(SyntheticWorld(quiet(GetParam())).frameRate_hz(),
            std::string(GetParam()) == "street" ? 10.0 : 20.0);
}

TEST_P(EveryScene, MovesForwardAtItsSpeed) {
  const SyntheticWorld world(quiet(GetParam()));
  const Eigen::Vector3d step =
      (world.pose(20).T_world_camera.inverse() * world.pose(21).T_world_camera).translation();
  const double speed = step.norm() * world.frameRate_hz();
  const bool street = std::string(GetParam()) == "street";
  EXPECT_GT(speed, street ? 4.0 : 0.5);
  EXPECT_LT(speed, street ? 15.0 : 2.2);
  EXPECT_GT(step.z(), 0.9 * step.norm());
}

TEST_P(EveryScene, StandsStill) {
  SyntheticWorldOptions options = quiet(GetParam());
  options.speed = 0.0;
  options.rotation = 0.0;
  const SyntheticWorld world(options);
  EXPECT_TRUE(world.pose(500).T_world_camera.isApprox(Eigen::Isometry3d::Identity(), 1e-12));
  EXPECT_EQ(difference(world.render(0).left, world.render(500).left), 0.0);
  options.rotation = 1.0;  // sways on the spot
  EXPECT_THROW(SyntheticWorld(options).framesForLength(1.0), std::invalid_argument);
}

INSTANTIATE_TEST_SUITE_P(SyntheticWorld, EveryScene,
                         testing::Values("street", "indoor", "corridor", "plaster"));

TEST(SyntheticWorld, IndoorImagesAreRawAndTheStreetIsRectified) {
  EXPECT_FALSE(SyntheticWorld(quiet("street")).needsRectification());
  const SyntheticWorld indoor(quiet("indoor"));
  EXPECT_TRUE(indoor.needsRectification());
  EXPECT_FALSE(indoor.calibration().left.D.empty());
  EXPECT_NEAR(rectifiedCamera(indoor.calibration()).baseline_m, 0.11, 0.001);
  EXPECT_NEAR(rectifiedCamera(SyntheticWorld(quiet("street")).calibration()).baseline_m, 0.5372,
              0.0001);
}

// The pair agrees with its calibration: the vertical disparity of corners is 0.
TEST(SyntheticWorld, RowsOfTheRectifiedPairCorrespond) {
  const SyntheticWorld world(quiet("indoor"));
  const StereoRectifier rectifier(world.calibration());
  const StereoImages images = rectifier.rectify(world.render(70));
  std::vector<cv::Point2f> corners;
  const cv::Rect inner(160, 40, 552, 400);
  cv::goodFeaturesToTrack(images.left(inner), corners, 60, 0.05, 25.0);
  int found = 0;
  for (const cv::Point2f& corner : corners) {
    const int x = static_cast<int>(corner.x) + inner.x - 15;
    const int y = static_cast<int>(corner.y) + inner.y - 15;
    cv::Mat scores;
    cv::matchTemplate(images.right(cv::Rect(x - 140, y - 4, 140 + 31, 31 + 8)),
                      images.left(cv::Rect(x, y, 31, 31)), scores, cv::TM_CCOEFF_NORMED);
    double best = 0.0;
    cv::Point place;
    cv::minMaxLoc(scores, nullptr, &best, nullptr, &place);
    if (best < 0.97) continue;  // partly hidden
    ++found;
    EXPECT_LE(std::abs(place.y - 4), 1) << x << ", " << y;
  }
  EXPECT_GT(found, 15);
}

TEST(SyntheticWorld, FollowsAPath) {
  SyntheticWorldOptions options = quiet("corridor");
  StampedPose first;
  first.stamp_ns = 5000000000;
  first.T_world_camera.translation() = Eigen::Vector3d(7.0, 8.0, 9.0);
  StampedPose second = first;
  second.stamp_ns = 6000000000;
  second.T_world_camera.translation().z() += 0.4;
  second.T_world_camera.linear() =
      Eigen::AngleAxisd(0.2, Eigen::Vector3d::UnitY()).toRotationMatrix();
  options.path = {first, second};
  const SyntheticWorld world(options);
  EXPECT_TRUE(world.pose(0).T_world_camera.isApprox(Eigen::Isometry3d::Identity(), 1e-12));
  const Eigen::Isometry3d half = world.pose(10).T_world_camera;
  EXPECT_TRUE(half.translation().isApprox(Eigen::Vector3d(0.0, 0.0, 0.2), 1e-9));
  EXPECT_NEAR(Eigen::AngleAxisd(half.linear()).angle(), 0.1, 1e-9);
  const Eigen::Isometry3d end = first.T_world_camera.inverse() * second.T_world_camera;
  EXPECT_TRUE(world.pose(20).T_world_camera.isApprox(end, 1e-9));
  EXPECT_TRUE(world.pose(900).T_world_camera.isApprox(end, 1e-9));
}

TEST(SyntheticWorld, LengthIsTranslatedToFrames) {
  const SyntheticWorld world(quiet("street"));
  const std::size_t frames = world.framesForLength(50.0);
  double travelled_m = 0.0;
  for (std::size_t i = 1; i < frames; ++i) {
    travelled_m += (world.pose(i).T_world_camera.translation() -
                    world.pose(i - 1).T_world_camera.translation())
                       .norm();
  }
  EXPECT_GE(travelled_m, 50.0);
  EXPECT_LT(travelled_m, 51.5);
  EXPECT_EQ(world.framesForLength(0.0), 2U);
}

TEST(SyntheticWorld, CarsMoveAndTheStreetStays) {
  SyntheticWorldOptions options = quiet("street");
  options.speed = 0.0;
  options.rotation = 0.0;
  options.moving_objects = 6;
  const SyntheticWorld world(options);
  cv::Mat changed;
  cv::absdiff(world.render(0).left, world.render(20).left, changed);
  const double share = cv::countNonZero(changed) / static_cast<double>(changed.total());
  EXPECT_GT(share, 0.002);
  EXPECT_LT(share, 0.5);
}

/// Share of the pixels of the first frame with a strong gradient.
double shareOfEdges(const SyntheticWorldOptions& options) {
  const cv::Mat image = SyntheticWorld(options).render(0).left;
  cv::Mat gradient;
  cv::Sobel(image, gradient, CV_32F, 1, 0);
  return cv::countNonZero(cv::abs(gradient) > 60.0) / static_cast<double>(image.total());
}

TEST(SyntheticWorld, OpenCountryHasFewEdges) {
  for (const int seed : {1, 2, 3}) {
    SyntheticWorldOptions options = quiet("street");
    options.seed = seed;
    const double town = shareOfEdges(options);
    options.open_country = 1.0;
    const double country = shareOfEdges(options);
    EXPECT_GT(country, 0.0) << seed;
    EXPECT_LT(country, 0.2 * town) << seed;
  }
}

/// The road is another one, the sky and the fronts of the houses are not.
TEST(SyntheticWorld, OnlyWhatIsLevelRepeats) {
  SyntheticWorldOptions options;
  options.noise = 0.0;
  const cv::Mat before = SyntheticWorld(options).render(0).left;
  options.repetition_m = 2.0;
  const cv::Mat after = SyntheticWorld(options).render(0).left;
  const cv::Mat differs = before != after;
  const cv::Mat upper = differs.rowRange(0, differs.rows / 4);
  EXPECT_LT(cv::countNonZero(upper), 0.03 * static_cast<double>(upper.total()));  // sills, chimneys
  EXPECT_GT(cv::countNonZero(differs), 0.2 * static_cast<double>(differs.total()));
}

/// What is not masked is the same scene as without the bonnet; what is masked is at rest, but for
/// what it reflects, and is a surface in front of both cameras.
TEST(SyntheticWorld, TheBonnetIsWhereItsMasksSay) {
  for (const char* scene : {"street", "corridor"}) {
    SyntheticWorldOptions options;
    options.scene = scene;
    options.noise = 0.0;
    const StereoImages plain = SyntheticWorld(options).render(5);
    EXPECT_TRUE(plain.left_mask.empty());
    options.bonnet = 1.0;
    const SyntheticWorld world(options);
    const StereoImages images = world.render(5);
    const StereoImages later = world.render(25);
    for (const auto& [image, clear, other, mask] :
         {std::tie(images.left, plain.left, later.left, images.left_mask),
          std::tie(images.right, plain.right, later.right, images.right_mask)}) {
      ASSERT_EQ(mask.size(), image.size());
      const double share = 1.0 - cv::countNonZero(mask) / static_cast<double>(mask.total());
      EXPECT_GT(share, 0.05) << scene;
      EXPECT_LT(share, 0.5) << scene;
      cv::Mat difference;
      cv::absdiff(image, clear, difference);
      EXPECT_LE(cv::norm(difference, cv::NORM_INF, mask), 1.0) << scene;
      EXPECT_GT(cv::mean(difference, mask == 0)[0], 10.0) << scene;
      cv::absdiff(image, other, difference);
      EXPECT_LT(cv::mean(difference, mask == 0)[0], 0.5 * cv::mean(difference, mask)[0]) << scene;
      cv::Scalar mean;
      cv::Scalar deviation;
      cv::meanStdDev(image, mean, deviation, mask == 0);
      EXPECT_GT(deviation[0], 15.0) << "no texture: " << scene;
    }
  }
}

TEST(SyntheticWorld, MotionBlurSmearsAlongTheMotion) {
  SyntheticWorldOptions options = quiet("street");
  options.lens_blur_px = 0.0;
  const cv::Mat sharp = SyntheticWorld(options).render(40).left;
  options.motion_blur_ms = 60.0;
  const cv::Mat blurred = SyntheticWorld(options).render(40).left;
  const auto sharpness = [](const cv::Mat& image) {
    cv::Mat gradient;
    cv::Sobel(image.colRange(0, 250), gradient, CV_32F, 1, 0);  // where it passes fastest
    return cv::norm(gradient, cv::NORM_L1);
  };
  EXPECT_LT(sharpness(blurred), 0.8 * sharpness(sharp));
  EXPECT_NEAR(cv::mean(blurred)[0], cv::mean(sharp)[0], 4.0);
}

TEST(SyntheticWorld, EachImageOfEitherCameraIsExposedAnew) {
  SyntheticWorldOptions options;
  options.scene = "indoor";
  options.speed = 0.0;
  options.rotation = 0.0;
  options.exposure_ev = -1.0;  // so that nothing saturates
  const SyntheticWorld evenly(options);
  options.exposure_jitter_ev = 0.5;
  const SyntheticWorld unevenly(options);
  std::vector<double> stops;
  for (std::size_t frame = 0; frame < 10; ++frame) {
    const StereoImages even = evenly.render(frame);
    const StereoImages uneven = unevenly.render(frame);
    stops.push_back(std::log2(cv::mean(uneven.left)[0] / cv::mean(even.left)[0]));
    stops.push_back(std::log2(cv::mean(uneven.right)[0] / cv::mean(even.right)[0]));
    EXPECT_GT(std::abs(stops.back() - stops.end()[-2]), 0.005) << "one camera by itself";
  }
  const auto [least, most] = std::minmax_element(stops.begin(), stops.end());
  EXPECT_GT(*least, -0.55);
  EXPECT_LT(*least, -0.3);
  EXPECT_LT(*most, 0.55);
  EXPECT_GT(*most, 0.3);
}

/// Row y is that of an image which a global shutter takes (y / height - 1/2) read-outs later.
TEST(SyntheticWorld, RowsOfARollingShutterAreExposedOneAfterTheOther) {
  for (const char* scene : {"indoor", "street"}) {
    SyntheticWorldOptions options = quiet(scene);
    options.rotation = 5.0;
    options.frame_rate_hz = 100.0;
    options.lens_blur_px = 0.0;
    options.vignetting = 0.0;
    const SyntheticWorld global(options);
    options.rolling_shutter_ms = 40.0;
    const SyntheticWorld rolling(options);
    constexpr int kFrame = 60;
    const StereoImages images = rolling.render(kFrame);
    EXPECT_EQ(images.stamp_ns, global.pose(kFrame).stamp_ns);
    const int height = images.left.rows;
    const auto difference = [&](int quarter, int ticks) {
      const StereoImages then = global.render(kFrame + ticks);
      const cv::Range rows(height * quarter / 4 - 2, height * quarter / 4 + 2);
      return cv::norm(images.left.rowRange(rows), then.left.rowRange(rows), cv::NORM_L1) +
             cv::norm(images.right.rowRange(rows), then.right.rowRange(rows), cv::NORM_L1);
    };
    for (int quarter = 1; quarter < 4; ++quarter) {  // 10 ms, a tick, apart
      const double there = difference(quarter, quarter - 2);
      EXPECT_LT(there, 0.5 * difference(quarter, quarter - 3)) << scene << ' ' << quarter;
      EXPECT_LT(there, 0.5 * difference(quarter, quarter - 1)) << scene << ' ' << quarter;
    }
    const StereoImages again = SyntheticWorld(options).render(kFrame);
    EXPECT_EQ(cv::norm(images.left, again.left, cv::NORM_INF), 0.0);
  }
}

TEST(SyntheticWorld, AllWrongOptionsAreNamed) {
  SyntheticWorldOptions options;
  options.scene = "moon";
  options.speed = -1.0;
  options.noise = std::numeric_limits<double>::quiet_NaN();
  StampedPose pose;
  options.path = {pose, pose};
  EXPECT_EQ(checkWorldOptions(options).size(), 4U);
  try {
    const SyntheticWorld world(options);
    FAIL();
  } catch (const std::invalid_argument& error) {
    for (const char* word : {"moon", "corridor", "speed", "noise", "pose 1"}) {
      EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << error.what();
    }
  }
  EXPECT_TRUE(checkWorldOptions(SyntheticWorldOptions()).empty());
}

cv::Mat evenLight(float value) { return cv::Mat(120, 160, CV_32FC1, cv::Scalar(value)); }

TEST(Sensor, NoiseHasTheGivenDeviationAndAMeanOfZero) {
  world::Sensor sensor;
  sensor.vignetting = 0.0;
  sensor.noise = 4.0;
  const float middle = 128.0F / 235.0F;
  cv::Scalar mean;
  cv::Scalar deviation;
  const cv::Mat a = world::expose(evenLight(middle), sensor, 1);
  cv::meanStdDev(a, mean, deviation);
  EXPECT_NEAR(mean[0], 128.0, 0.2);
  EXPECT_NEAR(deviation[0], 4.0, 0.15);
  const cv::Mat b = world::expose(evenLight(middle), sensor, 2);
  cv::Mat product;
  cv::multiply(a - 0.0, b - 0.0, product, 1.0, CV_64F);
  EXPECT_NEAR(cv::mean(product)[0], 128.0 * 128.0, 80.0);  // independent
  cv::meanStdDev(world::expose(evenLight(0.05F), sensor, 1), mean, deviation);
  EXPECT_LT(deviation[0], 3.0);  // less in the dark
}

TEST(Sensor, ExposureDoublesByStops) {
  world::Sensor sensor;
  sensor.noise = 0.0;
  sensor.vignetting = 0.0;
  const double normal = cv::mean(world::expose(evenLight(0.2F), sensor, 1))[0];
  sensor.exposure_ev = 1.0;
  EXPECT_NEAR(cv::mean(world::expose(evenLight(0.2F), sensor, 1))[0], 2.0 * normal, 1.0);
  sensor.exposure_ev = 4.0;
  EXPECT_NEAR(cv::mean(world::expose(evenLight(0.2F), sensor, 1))[0], 255.0, 1e-6);
}

TEST(Sensor, VignettingDarkensTheCorners) {
  world::Sensor sensor;
  sensor.noise = 0.0;
  sensor.vignetting = 0.4;
  const cv::Mat image = world::expose(evenLight(0.5F), sensor, 1);
  EXPECT_NEAR(image.at<std::uint8_t>(0, 0) / static_cast<double>(image.at<std::uint8_t>(60, 80)),
              0.6, 0.02);
}

}  // namespace
}  // namespace point_line_odometry
