#include "point_line_odometry/rectification.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "geometry/raw_camera.h"

namespace point_line_odometry {
namespace {

constexpr int kWidth = 640;
constexpr int kHeight = 480;
constexpr double kFocal_px = 500.0;

CameraCalibration makeCamera() {
  CameraCalibration camera;
  camera.width = kWidth;
  camera.height = kHeight;
  camera.K << kFocal_px, 0.0, 320.0, 0.0, kFocal_px, 240.0, 0.0, 0.0, 1.0;
  camera.D.assign(5, 0.0);
  return camera;
}

/// A pair that is already rectified, with a baseline of 0.2 m.
StereoCalibration makeRectifiedPair() {
  StereoCalibration calibration{makeCamera(), makeCamera()};
  for (CameraCalibration* camera : {&calibration.left, &calibration.right}) {
    camera->P.leftCols<3>() = camera->K;
  }
  calibration.right.P(0, 3) = -kFocal_px * 0.2;
  return calibration;
}

/// Pose of a right camera that is rotated by a few degrees and shifted mainly along x.
Eigen::Isometry3d makeTurnedPose() {
  Eigen::Isometry3d T_left_right = Eigen::Isometry3d::Identity();
  T_left_right.linear() = (Eigen::AngleAxisd(0.03, Eigen::Vector3d::UnitX()) *
                           Eigen::AngleAxisd(-0.05, Eigen::Vector3d::UnitY()) *
                           Eigen::AngleAxisd(0.02, Eigen::Vector3d::UnitZ()))
                              .toRotationMatrix();
  T_left_right.translation() = Eigen::Vector3d(0.12, 0.004, -0.006);
  return T_left_right.inverse();
}

StereoImages makeNoise(int seed) {
  StereoImages images;
  images.stamp_ns = 7;
  cv::RNG random(static_cast<std::uint64_t>(seed));
  for (cv::Mat* image : {&images.left, &images.right}) {
    image->create(kHeight, kWidth, CV_8UC1);
    random.fill(*image, cv::RNG::UNIFORM, 0, 256);
  }
  return images;
}

bool equal(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() && cv::norm(a, b, cv::NORM_INF) == 0.0;
}

/// Asserts that the call throws std::invalid_argument with these words.
void expectInvalid(const std::function<void()>& call, const std::string& words) {
  try {
    call();
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
    return;
  }
  ADD_FAILURE() << "nothing was thrown; expected: " << words;
}

/// Asserts that a pair is refused after a change, with these words.
void expectRefused(const std::function<void(StereoCalibration&)>& change,
                   const std::string& words) {
  StereoCalibration calibration = makeRectifiedPair();
  change(calibration);
  expectInvalid([&] { rectifiedCamera(calibration); }, words);
}

// --- rectifiedCamera --------------------------------------------------------------------------

TEST(RectifiedCamera, ReadsTheProjections) {
  const StereoCamera camera = rectifiedCamera(makeRectifiedPair());
  EXPECT_EQ(camera.fx, kFocal_px);
  EXPECT_EQ(camera.fy, kFocal_px);
  EXPECT_EQ(camera.cx, 320.0);
  EXPECT_EQ(camera.cy, 240.0);
  EXPECT_DOUBLE_EQ(camera.baseline_m, 0.2);
  EXPECT_EQ(camera.width, kWidth);
  EXPECT_EQ(camera.height, kHeight);
}

TEST(RectifiedCamera, KnowsHowManyRowsOfTheRawImageItShows) {
  StereoCalibration pair = makeRectifiedPair();
  EXPECT_NEAR(rectifiedCamera(pair).raw_rows, 1.0, 1e-6);
  for (CameraCalibration* camera : {&pair.left, &pair.right})
    camera->P.topLeftCorner<2, 2>() *= 1.25;
  EXPECT_NEAR(rectifiedCamera(pair).raw_rows, 0.8, 1e-6) << "enlarged";
  // A camera that is mounted upside down reads its rows out from below.
  for (CameraCalibration* camera : {&pair.left, &pair.right})
    camera->R = Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  EXPECT_NEAR(rectifiedCamera(pair).raw_rows, -0.8, 1e-6);
  for (CameraCalibration* camera : {&pair.left, &pair.right})
    camera->R = Eigen::AngleAxisd(0.5 * M_PI, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  EXPECT_EQ(rectifiedCamera(pair).raw_rows, 0.0) << "rows became columns";
  pair.left.K.setZero();
  EXPECT_EQ(rectifiedCamera(pair).raw_rows, 1.0) << "only P is known, of rectified images";
}

TEST(RectifiedCamera, DisparityOfAPointByHand) {
  const StereoCamera camera = rectifiedCamera(makeRectifiedPair());
  const Eigen::Vector3d p_camera(0.5, 0.25, 5.0);  // disparity 500 * 0.2 / 5 = 20 px
  EXPECT_TRUE(camera.projectLeft(p_camera).isApprox(Eigen::Vector2d(370.0, 265.0)));
  EXPECT_TRUE(camera.projectRight(p_camera).isApprox(Eigen::Vector2d(350.0, 265.0)));
}

TEST(RectifiedCamera, RefusesInvalidProjections) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  expectRefused([](auto& c) { c.left.P.setZero(); }, "left camera: P is all zero");
  expectRefused([nan](auto& c) { c.right.P(1, 2) = nan; }, "right camera: P has values");
  expectRefused([](auto& c) { c.left.P(0, 0) = -500.0; }, "focal lengths -500");
  expectRefused([](auto& c) { c.right.P(0, 2) += 3.0; }, "P of the left and right camera differ");
  expectRefused([](auto& c) { c.right.P(0, 3) = 100.0; }, "swap left and right");
  expectRefused([](auto& c) { c.right.P(0, 3) = 0.0; }, "no baseline");
  expectRefused([](auto& c) { c.left.P(2, 2) = 0.0; }, "third row of P is 0 0 0 0");
  expectRefused([](auto& c) { c.right.width = 320; }, "both must have the same size");
  expectRefused([](auto& c) { c.left.height = 0; }, "left camera: the size is 640 x 0");
}

TEST(StereoCameraTest, ValidateNamesFieldAndValue) {
  const StereoCamera good = rectifiedCamera(makeRectifiedPair());
  EXPECT_NO_THROW(good.validate());
  StereoCamera bad = good;
  bad.fx = 0.0;
  expectInvalid([&] { bad.validate(); }, "fx is 0");
  bad = good;
  bad.baseline_m = -0.5;
  expectInvalid([&] { bad.validate(); }, "baseline_m is -0.5");
  bad = good;
  bad.cx = std::numeric_limits<double>::infinity();
  expectInvalid([&] { bad.validate(); }, "cx is inf");
  bad = good;
  bad.width = -3;
  expectInvalid([&] { bad.validate(); }, "width is -3");
  bad = good;
  bad.width = 33000;
  expectInvalid([&] { bad.validate(); }, "width is 33000 px, but at most 32767");
}

// --- rectifyCalibration -----------------------------------------------------------------------

/// Raw pixel of a point in a pinhole camera without distortion, rotated into the rectified one.
Eigen::Vector2d rectifyPixel(const CameraCalibration& camera, const Eigen::Vector3d& p_raw) {
  const Eigen::Vector3d p = camera.P.leftCols<3>() * (camera.R * p_raw);
  return p.hnormalized();
}

TEST(RectifyCalibration, LeavesARectifiedPairUnchanged) {
  Eigen::Isometry3d T_right_left = Eigen::Isometry3d::Identity();
  T_right_left.translation().x() = -0.2;
  const StereoCalibration result = rectifyCalibration(makeRectifiedPair(), T_right_left);
  EXPECT_TRUE(result.left.R.isIdentity(1e-12));
  EXPECT_TRUE(result.right.R.isIdentity(1e-12));
  EXPECT_NEAR(rectifiedCamera(result).baseline_m, 0.2, 1e-12);
  EXPECT_NEAR(result.left.P(0, 0), kFocal_px, 3.0);
}

TEST(RectifyCalibration, ProjectsAPointToTheSameRowOfBothImages) {
  const Eigen::Isometry3d T_right_left = makeTurnedPose();
  const StereoCalibration result = rectifyCalibration({makeCamera(), makeCamera()}, T_right_left);
  const StereoCamera camera = rectifiedCamera(result);
  EXPECT_NEAR(camera.baseline_m, T_right_left.translation().norm(), 1e-9);
  std::mt19937 random(3);
  std::uniform_real_distribution<double> side(-2.0, 2.0);
  std::uniform_real_distribution<double> depth(2.0, 30.0);
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d p_left(side(random), side(random), depth(random));
    const Eigen::Vector2d left = rectifyPixel(result.left, p_left);
    const Eigen::Vector2d right = rectifyPixel(result.right, T_right_left * p_left);
    EXPECT_NEAR(left.y(), right.y(), 1e-6);
    const Eigen::Vector3d p_rectified = result.left.R * p_left;
    EXPECT_NEAR(left.x() - right.x(), camera.fx * camera.baseline_m / p_rectified.z(), 1e-6);
  }
}

TEST(RectifyCalibration, IsDeterministic) {
  const StereoCalibration first =
      rectifyCalibration({makeCamera(), makeCamera()}, makeTurnedPose());
  const StereoCalibration second =
      rectifyCalibration({makeCamera(), makeCamera()}, makeTurnedPose());
  EXPECT_EQ(first.left.P, second.left.P);
  EXPECT_EQ(first.right.P, second.right.P);
  EXPECT_EQ(first.left.R, second.left.R);
  EXPECT_EQ(first.right.R, second.right.R);
}

TEST(RectifyCalibration, SupportsEveryDistortionModel) {
  for (const auto& [model, count] : {std::pair<const char*, std::size_t>{"plumb_bob", 4},
                                     {"plumb_bob", 5},
                                     {"rational_polynomial", 8},
                                     {"equidistant", 4},
                                     {"plumb_bob", 0}}) {
    CameraCalibration camera = makeCamera();
    camera.distortion_model = model;
    camera.D.assign(count, 0.001);
    const StereoCalibration result = rectifyCalibration({camera, camera}, makeTurnedPose());
    EXPECT_GT(rectifiedCamera(result).baseline_m, 0.1) << model;
    EXPECT_NO_THROW(StereoRectifier{result}) << model;
  }
}

TEST(RectifyCalibration, RefusesInvalidCalibrations) {
  const auto refuse = [](const std::function<void(CameraCalibration&)>& change,
                         const std::string& words) {
    CameraCalibration left = makeCamera();
    change(left);
    expectInvalid([&] { rectifyCalibration({left, makeCamera()}, makeTurnedPose()); }, words);
  };
  refuse([](auto& c) { c.distortion_model = "omni"; }, "'omni' is unknown");
  refuse([](auto& c) { c.D.assign(3, 0.0); }, "D has 3 coefficients");
  refuse([](auto& c) { c.D[0] = std::nan(""); }, "D is not finite");
  refuse([](auto& c) { c.K.setZero(); }, "left camera: K has focal lengths 0 and 0");
  refuse([](auto& c) { c.width = 0; }, "the size is 0 x 480");
  refuse([](auto& c) { c.D.assign(4, 0.0), c.distortion_model = "equidistant"; }, "of one kind");
  expectInvalid(
      [] {
        rectifyCalibration({makeCamera(), makeCamera()}, Eigen::Isometry3d::Identity());
      },
      "0 m apart");
}

// --- StereoRectifier --------------------------------------------------------------------------

TEST(StereoRectifierTest, UndistortedRectifiedPairIsUnchanged) {
  const StereoRectifier rectifier(makeRectifiedPair());
  const StereoImages raw = makeNoise(1);
  const StereoImages rectified = rectifier.rectify(raw);
  EXPECT_TRUE(equal(rectified.left, raw.left));
  EXPECT_TRUE(equal(rectified.right, raw.right));
  EXPECT_EQ(rectified.stamp_ns, 7);
  EXPECT_TRUE(rectifier.R_rectified_raw().isIdentity(0.0));
  EXPECT_EQ(rectifier.camera(), rectifiedCamera(makeRectifiedPair()));
}

/// As with alpha 1 of stereoRectify: pixels beside the raw image are black, and none is of the
/// scene.
TEST(StereoRectifierTest, MasksWhatTheRawImageDoesNotShow) {
  StereoCalibration calibration = makeRectifiedPair();
  for (CameraCalibration* camera : {&calibration.left, &calibration.right})
    camera->P(0, 0) = camera->P(1, 1) = 0.8 * kFocal_px;
  calibration.right.P(0, 3) *= 0.8;
  const StereoRectifier rectifier(calibration);
  StereoImages raw = makeNoise(1);
  raw.left_mask = cv::Mat(kHeight, kWidth, CV_8UC1, cv::Scalar(255));
  raw.left_mask.colRange(0, kWidth / 2).setTo(0);
  const StereoImages rectified = rectifier.rectify(raw);
  ASSERT_EQ(rectified.right_mask.size(), rectified.right.size());
  const double seen = cv::countNonZero(rectified.right_mask);
  EXPECT_NEAR(seen / (kWidth * kHeight), 0.8 * 0.8, 0.01);
  EXPECT_EQ(cv::countNonZero(rectified.right & (rectified.right_mask == 0)), 0);
  EXPECT_NEAR(cv::countNonZero(rectified.left_mask) / seen, 0.5, 0.01);
  EXPECT_TRUE(StereoRectifier(makeRectifiedPair()).rectify(makeNoise(1)).left_mask.empty());
}

TEST(StereoRectifierTest, MovesAPatchToItsProjection) {
  const Eigen::Isometry3d T_right_left = makeTurnedPose();
  const StereoCalibration calibration =
      rectifyCalibration({makeCamera(), makeCamera()}, T_right_left);
  const Eigen::Vector3d p_left(0.3, -0.2, 4.0);
  const Eigen::Vector3d p_right = T_right_left * p_left;
  StereoImages raw;
  const auto draw = [](const Eigen::Vector3d& p, cv::Mat* image) {
    *image = cv::Mat::zeros(kHeight, kWidth, CV_8UC1);
    const Eigen::Vector2d px = (makeCamera().K * p).hnormalized();
    constexpr int kShift = 8;
    cv::circle(*image, cv::Point2d(px.x(), px.y()) * (1 << kShift), 6 << kShift, 255, cv::FILLED,
               cv::LINE_AA, kShift);
  };
  draw(p_left, &raw.left);
  draw(p_right, &raw.right);
  const StereoImages rectified = StereoRectifier(calibration).rectify(raw);
  const auto centre = [](const cv::Mat& image) {
    const cv::Moments m = cv::moments(image);
    return Eigen::Vector2d(m.m10 / m.m00, m.m01 / m.m00);
  };
  EXPECT_LT((centre(rectified.left) - rectifyPixel(calibration.left, p_left)).norm(), 0.1);
  EXPECT_LT((centre(rectified.right) - rectifyPixel(calibration.right, p_right)).norm(), 0.1);
}

/// Pixel in the raw image of a fisheye camera: the angle to the axis, distorted, times the focal
/// length (Kannala and Brandt 2006).
Eigen::Vector2d fisheyePixel(const CameraCalibration& camera, const Eigen::Vector3d& p_raw) {
  const double radius = p_raw.head<2>().norm();
  const double theta = std::atan2(radius, p_raw.z());
  double distorted = theta;
  for (std::size_t i = 0; i < camera.D.size(); ++i)
    distorted += camera.D[i] * std::pow(theta, 2.0 * static_cast<double>(i) + 3.0);
  const Eigen::Vector2d image = distorted / radius * p_raw.head<2>();
  return (camera.K * image.homogeneous()).hnormalized();
}

TEST(StereoRectifierTest, MovesAPatchOfAFisheyeImageToItsProjection) {
  CameraCalibration fisheye = makeCamera();
  fisheye.K.topLeftCorner<2, 2>() *= 0.5;  // 75 degrees from the axis to the edge
  fisheye.D = {-0.03, 0.01, -0.006, 0.001};
  fisheye.distortion_model = "equidistant";
  const Eigen::Isometry3d T_right_left = makeTurnedPose();
  const StereoCalibration calibration = rectifyCalibration({fisheye, fisheye}, T_right_left);
  const StereoRectifier rectifier(calibration);
  for (const Eigen::Vector2d& side :
       {Eigen::Vector2d(0.1, 0.05), Eigen::Vector2d(-0.5, 0.4), Eigen::Vector2d(0.7, -0.4)}) {
    const Eigen::Vector3d p_left = 3.0 * side.homogeneous();
    const Eigen::Vector3d p_right = T_right_left * p_left;
    StereoImages raw;
    for (auto [p, image] : {std::pair(p_left, &raw.left), std::pair(p_right, &raw.right)}) {
      *image = cv::Mat::zeros(kHeight, kWidth, CV_8UC1);
      const Eigen::Vector2d px = fisheyePixel(fisheye, p);
      constexpr int kShift = 8;
      cv::circle(*image, cv::Point2d(px.x(), px.y()) * (1 << kShift), 3 << kShift, 255, cv::FILLED,
                 cv::LINE_AA, kShift);
    }
    const StereoImages rectified = rectifier.rectify(raw);
    const auto expectAt = [](const Eigen::Vector2d& expected, const cv::Mat& image) {
      const cv::Moments m = cv::moments(image);
      ASSERT_GT(m.m00, 0.0) << "the patch is out of the image; expected at "
                            << expected.transpose();
      EXPECT_LT((Eigen::Vector2d(m.m10 / m.m00, m.m01 / m.m00) - expected).norm(), 0.2);
    };
    expectAt(rectifyPixel(calibration.left, p_left), rectified.left);
    expectAt(rectifyPixel(calibration.right, p_right), rectified.right);
  }
}

TEST(RawPixels, AreThoseThatRectifiedOnesComeFrom) {
  for (const char* model : {"plumb_bob", "rational_polynomial", "equidistant"}) {
    CameraCalibration camera = makeCamera();
    camera.distortion_model = model;
    camera.D = {-0.03, 0.01, -0.006, 0.001};
    if (camera.distortion_model == "rational_polynomial") camera.D.resize(8, 0.0);
    const StereoCalibration calibration = rectifyCalibration({camera, camera}, makeTurnedPose());
    for (const CameraCalibration& side : {calibration.left, calibration.right}) {
      Eigen::Matrix2Xd rectified(2, 3);
      rectified << 320.0, 20.0, 600.0, 240.0, 10.0, 470.0;
      const Eigen::Matrix2Xd raw = rawPixels(side, rectified);
      cv::Matx33d K;
      cv::eigen2cv(side.K, K);
      cv::Matx33d R;
      cv::eigen2cv(side.R, R);
      cv::Matx34d P;
      cv::eigen2cv(side.P, P);
      for (Eigen::Index i = 0; i < raw.cols(); ++i) {
        const std::vector<cv::Point2d> pixel{{raw(0, i), raw(1, i)}};
        std::vector<cv::Point2d> back;
        if (camera.distortion_model == "equidistant") {
          cv::fisheye::undistortPoints(pixel, back, K, side.D, R, P);
        } else {
          cv::undistortPoints(pixel, back, K, side.D, R, P,
                              {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 100, 1e-12});
        }
        EXPECT_NEAR(back[0].x, rectified(0, i), 1e-4) << model;
        EXPECT_NEAR(back[0].y, rectified(1, i), 1e-4) << model;
      }
    }
  }
}

TEST(RawPixels, AreTheSameWithoutDistortionAndRotation) {
  const CameraCalibration camera = makeRectifiedPair().left;
  const Eigen::Matrix2Xd pixels = (Eigen::Matrix2Xd(2, 2) << 3.0, 630.5, 7.25, 470.0).finished();
  EXPECT_LT((rawPixels(camera, pixels) - pixels).norm(), 1e-9);
  EXPECT_EQ(rawPixels(camera, Eigen::Matrix2Xd(2, 0)).cols(), 0);
  EXPECT_THROW(rawPixels(makeCamera(), pixels), std::invalid_argument) << "without P";
  CameraCalibration unknown = camera;
  unknown.distortion_model = "mei";
  EXPECT_THROW(rawPixels(unknown, pixels), std::invalid_argument);
}

TEST(StereoRectifierTest, IsDeterministic) {
  CameraCalibration camera = makeCamera();
  camera.D = {-0.28, 0.07, 0.0002, 0.00002, 0.0};
  const StereoCalibration calibration = rectifyCalibration({camera, camera}, makeTurnedPose());
  const StereoImages raw = makeNoise(2);
  const StereoImages first = StereoRectifier(calibration).rectify(raw);
  const StereoImages second = StereoRectifier(calibration).rectify(raw);
  EXPECT_TRUE(equal(first.left, second.left));
  EXPECT_TRUE(equal(first.right, second.right));
}

TEST(StereoRectifierTest, RefusesImagesThatDoNotFit) {
  const StereoRectifier rectifier(makeRectifiedPair());
  StereoImages raw = makeNoise(3);
  raw.right = raw.right.rowRange(0, kHeight - 1);
  expectInvalid([&] { rectifier.rectify(raw); }, "640 x 479");
  raw = makeNoise(3);
  raw.left.convertTo(raw.left, CV_16UC1);
  expectInvalid([&] { rectifier.rectify(raw); }, "16 bit");
  expectInvalid([&] { rectifier.rectify(StereoImages()); }, "0 x 0");
}

TEST(StereoRectifierTest, RefusesInvalidCalibrations) {
  StereoCalibration calibration = makeRectifiedPair();
  calibration.right.R.setZero();
  expectInvalid([&] { StereoRectifier{calibration}; }, "right camera: R is not a rotation");
  calibration = makeRectifiedPair();
  calibration.left.K.setZero();
  expectInvalid([&] { StereoRectifier{calibration}; }, "left camera: K");
  calibration = makeRectifiedPair();
  calibration.right.P(0, 3) = 0.0;
  expectInvalid([&] { StereoRectifier{calibration}; }, "no baseline");
}

}  // namespace
}  // namespace point_line_odometry
