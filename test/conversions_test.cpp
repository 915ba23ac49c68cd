#include "ros/conversions.h"

#include <gtest/gtest.h>
#include <image_geometry/pinhole_camera_model.h>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "ros/calibration_conversion.h"
#include "ros/image_conversion.h"

namespace point_line_odometry {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

sensor_msgs::Image makeImage(const std::string& encoding, std::uint32_t width, std::uint32_t height,
                             const std::vector<std::uint8_t>& pixel) {
  sensor_msgs::Image image;
  image.encoding = encoding;
  image.width = width;
  image.height = height;
  image.step = width * static_cast<std::uint32_t>(pixel.size());
  for (std::uint32_t i = 0; i < width * height; ++i) {
    image.data.insert(image.data.end(), pixel.begin(), pixel.end());
  }
  return image;
}

/// Text of the MessageError that `call` throws; empty if it throws none.
template <typename Call>
std::string errorOf(const Call& call) {
  try {
    call();
  } catch (const MessageError& error) {
    return error.what();
  }
  return "";
}

::testing::AssertionResult contains(const std::string& text, const std::string& part) {
  if (text.find(part) != std::string::npos) return ::testing::AssertionSuccess();
  return ::testing::AssertionFailure() << "'" << part << "' is not in '" << text << "'";
}

std::string imageError(const sensor_msgs::Image& image) {
  return errorOf([&] { toGray(image); });
}

/// Infos of a good pair: f 500, c (319.5, 239.5), 640 x 480, baseline 0.12 m.
struct InfoPair {
  sensor_msgs::CameraInfo left;
  sensor_msgs::CameraInfo right;

  InfoPair() {
    left.width = 640;
    left.height = 480;
    left.distortion_model = "plumb_bob";
    left.D = {0.1, -0.2, 0.001, 0.002, 0.0};
    left.K = {510, 0, 320, 0, 511, 240, 0, 0, 1};
    left.R = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    left.P = {500, 0, 319.5, 0, 0, 500, 239.5, 0, 0, 0, 1, 0};
    right = left;
    right.P[3] = -60.0;
  }

  StereoCalibration convert() const { return toStereoCalibration(left, right); }
  std::string error() const {
    return errorOf([this] { convert(); });
  }
};

TEST(ToGray, TakesEveryEncodingOfTheTable) {
  const std::vector<std::pair<std::string, std::vector<std::uint8_t>>> pixels{
      {"mono8", {77}},
      {"8UC1", {77}},
      {"mono16", {200, 77}},
      {"16UC1", {200, 77}},
      {"bgr8", {77, 77, 77}},
      {"rgb8", {77, 77, 77}},
      {"bgra8", {77, 77, 77, 9}},
      {"rgba8", {77, 77, 77, 9}}};
  for (const auto& pixel : pixels) {
    const sensor_msgs::Image image = makeImage(pixel.first, 5, 3, pixel.second);
    const cv::Mat gray = toGray(image);
    ASSERT_EQ(gray.type(), CV_8UC1) << pixel.first;
    ASSERT_EQ(gray.size(), cv::Size(5, 3)) << pixel.first;
    EXPECT_EQ(cv::countNonZero(gray != 77), 0) << pixel.first;
  }
}

TEST(ToGray, KnowsTheOrderOfColours) {
  const int red_as_gray = 76;
  EXPECT_EQ(toGray(makeImage("bgr8", 1, 1, {0, 0, 255})).at<std::uint8_t>(0, 0), red_as_gray);
  EXPECT_EQ(toGray(makeImage("rgb8", 1, 1, {255, 0, 0})).at<std::uint8_t>(0, 0), red_as_gray);
  EXPECT_EQ(toGray(makeImage("bgra8", 1, 1, {0, 0, 255, 0})).at<std::uint8_t>(0, 0), red_as_gray);
  EXPECT_EQ(toGray(makeImage("rgba8", 1, 1, {255, 0, 0, 0})).at<std::uint8_t>(0, 0), red_as_gray);
}

TEST(ToGray, TakesTheHighByteOfEitherByteOrder) {
  sensor_msgs::Image image = makeImage("mono16", 1, 1, {0xFF, 0x12});
  EXPECT_EQ(toGray(image).at<std::uint8_t>(0, 0), 0x12);
  image.is_bigendian = 1;
  EXPECT_EQ(toGray(image).at<std::uint8_t>(0, 0), 0xFF);
}

TEST(ToGray, SharesTheMemoryOfMono8) {
  const sensor_msgs::Image image = makeImage("mono8", 4, 2, {5});
  EXPECT_EQ(toGray(image).data, image.data.data());
}

TEST(ToGray, SkipsThePaddingOfRows) {
  sensor_msgs::Image image = makeImage("mono8", 4, 2, {5});
  image.width = 3;
  image.data = {1, 2, 3, 99, 4, 5, 6, 99};
  const cv::Mat gray = toGray(image);
  EXPECT_EQ(gray.cols, 3);
  EXPECT_EQ(gray.at<std::uint8_t>(1, 0), 4);
  EXPECT_EQ(gray.at<std::uint8_t>(1, 2), 6);
}

TEST(ToGray, RefusesOtherEncodingsWithAHint) {
  EXPECT_TRUE(contains(imageError(makeImage("bayer_rggb8", 4, 4, {1})), "debayer"));
  EXPECT_TRUE(contains(imageError(makeImage("32FC1", 4, 4, {0, 0, 0, 0})), "mono8"));
  EXPECT_TRUE(contains(imageError(makeImage("", 4, 4, {1})), "encoding ''"));
}

TEST(ToGray, RefusesSizesThatContradictEachOther) {
  EXPECT_TRUE(contains(imageError(makeImage("mono8", 0, 4, {1})), "empty"));
  EXPECT_TRUE(contains(imageError(makeImage("mono8", 4, 0, {1})), "empty"));
  sensor_msgs::Image image = makeImage("bgr8", 4, 4, {1, 2, 3});
  image.step = 11;
  EXPECT_TRUE(contains(imageError(image), "step is 11"));
  image = makeImage("mono16", 4, 4, {1});
  EXPECT_TRUE(contains(imageError(image), "takes 8"));
  image = makeImage("mono8", 4, 4, {1});
  image.data.pop_back();
  EXPECT_TRUE(contains(imageError(image), "data has 15 bytes"));
  image.data.resize(17);
  EXPECT_TRUE(contains(imageError(image), "data has 17 bytes"));
  image = makeImage("mono8", 4, 4, {1});
  image.height = 0x80000000U;
  EXPECT_TRUE(contains(imageError(image), "larger than any camera"));
}

TEST(ToStereoImages, TakesTheStampOfTheLeftImage) {
  InfoPair infos;
  sensor_msgs::Image image = makeImage("mono8", 640, 480, {1});
  image.header.stamp = ros::Time(1403636579, 763555584);
  const StereoImages images = toStereoImages(image, image, infos.convert());
  EXPECT_EQ(images.stamp_ns, 1403636579763555584LL);
}

TEST(ToStereoImages, RefusesImagesOfAnotherSizeThanCalibrated) {
  const StereoCalibration calibration = InfoPair().convert();
  const auto good = makeImage("mono8", 640, 480, {1});
  const auto small = makeImage("mono8", 320, 240, {1});
  const auto error = [&](const sensor_msgs::Image& left, const sensor_msgs::Image& right) {
    return errorOf([&] { toStereoImages(left, right, calibration); });
  };
  EXPECT_EQ(error(good, good), "");
  EXPECT_TRUE(contains(error(small, good), "left image is 320 x 240"));
  EXPECT_TRUE(contains(error(good, small), "right image is 320 x 240"));
}

TEST(ToStereoCalibration, CopiesTheFields) {
  const StereoCalibration calibration = InfoPair().convert();
  EXPECT_EQ(calibration.left.width, 640);
  EXPECT_EQ(calibration.left.K(0, 2), 320.0);
  EXPECT_EQ(calibration.left.K(1, 1), 511.0);
  EXPECT_EQ(calibration.left.D.size(), 5U);
  EXPECT_EQ(calibration.right.P(0, 3), -60.0);
  EXPECT_EQ(calibration.right.P(1, 2), 239.5);
  EXPECT_DOUBLE_EQ(rectifiedCamera(calibration).baseline_m, 0.12);
}

TEST(ToStereoCalibration, AppliesRegionOfInterestThenBinning) {
  InfoPair infos;
  for (sensor_msgs::CameraInfo* info : {&infos.left, &infos.right}) {
    info->roi.x_offset = 100;
    info->roi.y_offset = 40;
    info->roi.width = 400;
    info->roi.height = 300;
    info->binning_x = 2;
    info->binning_y = 2;
  }
  const StereoCalibration calibration = infos.convert();
  EXPECT_EQ(calibration.left.width, 200);
  EXPECT_EQ(calibration.left.height, 150);
  EXPECT_DOUBLE_EQ(calibration.left.P(0, 0), 250.0);
  EXPECT_DOUBLE_EQ(calibration.left.P(0, 2), (319.5 - 100.0) / 2.0);
  EXPECT_DOUBLE_EQ(calibration.left.P(1, 2), (239.5 - 40.0) / 2.0);
  EXPECT_DOUBLE_EQ(calibration.left.K(1, 2), (240.0 - 40.0) / 2.0);
  EXPECT_DOUBLE_EQ(calibration.right.P(0, 3), -30.0);
  EXPECT_DOUBLE_EQ(rectifiedCamera(calibration).baseline_m, 0.12);
}

/// image_geometry does not check camera_info; for a valid one its result is the same.
TEST(ToStereoCalibration, AgreesWithImageGeometry) {
  for (const std::uint32_t binning : {0U, 1U, 2U, 3U, 4U}) {
    InfoPair infos;
    infos.right.binning_x = binning;
    infos.right.binning_y = binning / 2;
    infos.right.roi.x_offset = 60;
    infos.right.roi.y_offset = 36;
    infos.right.roi.width = 480;
    infos.right.roi.height = 240;
    infos.left.binning_x = infos.right.binning_x;
    infos.left.binning_y = infos.right.binning_y;
    infos.left.roi = infos.right.roi;
    const CameraCalibration ours = infos.convert().right;
    image_geometry::PinholeCameraModel theirs;
    theirs.fromCameraInfo(infos.right);
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 4; ++column)
        EXPECT_NEAR(ours.P(row, column), theirs.projectionMatrix()(row, column), 1e-9) << binning;
      for (int column = 0; column < 3; ++column)
        EXPECT_NEAR(ours.K(row, column), theirs.intrinsicMatrix()(row, column), 1e-9) << binning;
    }
  }
}

TEST(ToStereoCalibration, NamesTheInvalidField) {
  InfoPair absent;
  absent.right.P.assign(0.0);
  EXPECT_TRUE(contains(absent.error(), "right/camera_info: P is all zero"));
  InfoPair not_finite;
  not_finite.left.P[2] = kNaN;
  EXPECT_TRUE(contains(not_finite.error(), "left/camera_info: P has an entry"));
  InfoPair negative_fx;
  negative_fx.left.P[0] = -500.0;
  EXPECT_TRUE(contains(negative_fx.error(), "P[0] (fx) is -500"));
  InfoPair zero_fy;
  zero_fy.right.P[5] = 0.0;
  EXPECT_TRUE(contains(zero_fy.error(), "right/camera_info: P[5] (fy) is 0"));
  InfoPair no_size;
  no_size.left.width = 0;
  EXPECT_TRUE(contains(no_size.error(), "left/camera_info: width is 0"));
}

TEST(ToStereoCalibration, NamesTheFaultOfAnInvalidPair) {
  InfoPair same;
  same.right = same.left;
  EXPECT_TRUE(contains(same.error(), "both topics carry the left camera's info"));
  InfoPair wrong_sign;
  wrong_sign.right.P[3] = 60.0;
  EXPECT_TRUE(contains(wrong_sign.error(), "swapped"));
  InfoPair swapped;
  std::swap(swapped.left, swapped.right);
  EXPECT_TRUE(contains(swapped.error(), "left/camera_info: P[3] is -60"));
  EXPECT_TRUE(contains(swapped.error(), "swapped"));
  InfoPair sizes;
  sizes.right.width = 320;
  EXPECT_TRUE(contains(sizes.error(), "same resolution"));
}

TEST(ToCameraInfo, IsTheInverseOfToStereoCalibration) {
  const InfoPair infos;
  const StereoCalibration calibration = infos.convert();
  EXPECT_TRUE(sameCalibration(toCameraInfo(calibration.left, {}), infos.left));
  EXPECT_TRUE(sameCalibration(toCameraInfo(calibration.right, {}), infos.right));
  EXPECT_FALSE(sameCalibration(infos.left, infos.right));
}

TEST(Poses, SurviveThereAndBack) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::AngleAxisd(-3.0, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  T.translation() = Eigen::Vector3d(4, 5, 6);
  EXPECT_TRUE(toIsometry(toPose(T)).isApprox(T, 1e-12));
  EXPECT_TRUE(toIsometry(toTransform(T)).isApprox(T, 1e-12));
  EXPECT_GE(toPose(T).orientation.w, 0.0);
}

TEST(Poses, AreRefusedIfInvalid) {
  geometry_msgs::Pose pose;
  EXPECT_TRUE(contains(errorOf([&] { toIsometry(pose); }), "it must be 1"));
  pose.orientation.w = 1.0;
  EXPECT_EQ(errorOf([&] { toIsometry(pose); }), "");
  pose.position.y = kNaN;
  EXPECT_TRUE(contains(errorOf([&] { toIsometry(pose); }), "not finite"));
}

TEST(Frames, LoseOneLeadingSlash) {
  EXPECT_EQ(withoutLeadingSlash("/camera"), "camera");
  EXPECT_EQ(withoutLeadingSlash("camera"), "camera");
  EXPECT_EQ(withoutLeadingSlash(""), "");
}

TEST(ToCovariance, IsRowMajor) {
  Matrix6d covariance = Matrix6d::Zero();
  covariance(1, 4) = 7.0;
  EXPECT_EQ(toCovariance(covariance)[10], 7.0);
}

}  // namespace
}  // namespace point_line_odometry
