#include "odometry/image_scaling.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "point_line_odometry/stereo_odometry.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

StereoCamera cameraOf(int width, int height) {
  StereoCamera camera;
  camera.fx = camera.fy = 700.0;
  camera.cx = 0.5 * width;
  camera.cy = 0.5 * height;
  camera.baseline_m = 0.5;
  camera.width = width;
  camera.height = height;
  return camera;
}

/// The camera whose images are those of another one, `factor` times as wide and high.
StereoCamera enlarged(StereoCamera camera, int factor) {
  camera.width *= factor;
  camera.height *= factor;
  camera.fx *= factor;
  camera.fy *= factor;
  camera.cx = factor * (camera.cx + 0.5) - 0.5;
  camera.cy = factor * (camera.cy + 0.5) - 0.5;
  return camera;
}

StereoImages resized(StereoImages images, const StereoCamera& camera, int interpolation) {
  for (cv::Mat* image : {&images.left, &images.right})
    cv::resize(*image, *image, {camera.width, camera.height}, 0.0, 0.0, interpolation);
  return images;
}

TEST(ImageScaling, UsualImagesAreUnchanged) {
  const StereoCamera camera = cameraOf(1242, 375);
  const ImageScaling scaling(camera, {});
  EXPECT_EQ(scaling.camera(), camera);
  const StereoImages images{cv::Mat(375, 1242, CV_8UC1), cv::Mat(375, 1242, CV_8UC1), 7};
  EXPECT_EQ(scaling.scale(images).left.data, images.left.data);
}

TEST(ImageScaling, LargeImagesOfAnySizeAreReducedBelowTheLimit) {
  for (const cv::Size& size : {cv::Size(1501, 1003), cv::Size(1920, 1080), cv::Size(3726, 1125),
                               cv::Size(3840, 2160), cv::Size(8000, 6001)}) {
    const ImageScaling scaling(cameraOf(size.width, size.height), {});
    const double megapixels = 1e-6 * scaling.camera().width * scaling.camera().height;
    EXPECT_LE(megapixels, 1.0);
    EXPECT_GT(megapixels, 0.24);
  }
}

TEST(ImageScaling, SmallImagesOfAnySizeAreEnlarged) {
  for (const cv::Size& size : {cv::Size(160, 120), cv::Size(320, 240), cv::Size(376, 240),
                               cv::Size(424, 240), cv::Size(621, 187)}) {
    const ImageScaling scaling(cameraOf(size.width, size.height), {});
    const double megapixels = 1e-6 * scaling.camera().width * scaling.camera().height;
    EXPECT_GE(megapixels, 0.2);
    EXPECT_LE(megapixels, 1.0);
    EXPECT_EQ(scaling.camera().width % size.width, 0);
  }
}

TEST(ImageScaling, NeverEnlargesBeyondTheLimitOfLargeImages) {
  TrackingParameters parameters;
  parameters.min_megapixels = 0.5;
  parameters.max_megapixels = 0.25;
  for (const cv::Size& size : {cv::Size(200, 150), cv::Size(400, 300), cv::Size(800, 600)}) {
    const ImageScaling scaling(cameraOf(size.width, size.height), parameters);
    EXPECT_LE(1e-6 * scaling.camera().width * scaling.camera().height, 0.25);
  }
}

class ImageScalingProjection : public ::testing::TestWithParam<cv::Size> {};

TEST_P(ImageScalingProjection, AgreesWithTheInputCamera) {
  const StereoCamera camera = cameraOf(GetParam().width, GetParam().height);
  const ImageScaling scaling(camera, {});
  const double ratio = camera.fx / scaling.camera().fx;
  ASSERT_NE(ratio, 1.0);
  const Eigen::Vector3d p(1.5, -0.7, 8.0);
  FrameResult result;
  result.points.resize(1);
  result.points[0].left_px = scaling.camera().projectLeft(p).cast<float>();
  result.points[0].right_px = scaling.camera().projectRight(p).cast<float>();
  result.lines.resize(1);
  result.lines[0].left_px = {result.points[0].left_px, result.points[0].right_px};
  result.unmatched_points_px = {result.points[0].left_px};
  result.unmatched_lines_px = {result.lines[0].left_px};
  result.rms_px = 0.5;
  scaling.toInputPixels(&result);
  const Eigen::Vector2f left = camera.projectLeft(p).cast<float>();
  const Eigen::Vector2f right = camera.projectRight(p).cast<float>();
  EXPECT_LT((result.points[0].left_px - left).norm(), 1e-3);
  EXPECT_LT((result.points[0].right_px - right).norm(), 1e-3);
  EXPECT_LT((result.lines[0].left_px.end - right).norm(), 1e-3);
  EXPECT_LT((result.unmatched_points_px[0] - left).norm(), 1e-3);
  EXPECT_LT((result.unmatched_lines_px[0].start - left).norm(), 1e-3);
  EXPECT_NEAR(result.rms_px, 0.5 * ratio, 1e-6);
}

INSTANTIATE_TEST_SUITE_P(Sizes, ImageScalingProjection,
                         ::testing::Values(cv::Size(1921, 1083), cv::Size(201, 150)));

TEST(ImageScaling, TheOdometryProcessesLargeImages) {
  const StereoCamera small = synthetic::roomCamera();
  Parameters parameters;
  parameters.tracking.max_megapixels = 1.01e-6 * small.width * small.height;
  const StereoCamera large = enlarged(small, 3);
  StereoOdometry of_small(small, parameters);
  StereoOdometry of_large(large, parameters);
  for (int i = 0; i < 4; ++i) {
    const StereoImages images = synthetic::frame(i);
    const FrameResult a = of_small.process(images);
    const FrameResult b = of_large.process(resized(images, large, cv::INTER_NEAREST));
    ASSERT_EQ(b.state, i == 0 ? TrackingState::kInitializing : TrackingState::kOk);
    EXPECT_TRUE(b.T_odom_camera.isApprox(a.T_odom_camera, 1e-6));
    ASSERT_EQ(b.points.size(), a.points.size());
  }
  EXPECT_EQ(of_large.camera(), large);
}

TEST(ImageScaling, TheOdometryProcessesSmallImages) {
  const StereoCamera small = synthetic::roomCamera();
  const StereoCamera large = enlarged(small, 2);
  StereoOdometry of_small(small, {});
  StereoOdometry of_large(large, {});
  for (int i = 0; i < 4; ++i) {
    const StereoImages images = synthetic::frame(i);
    const FrameResult a = of_small.process(images);
    const FrameResult b = of_large.process(resized(images, large, cv::INTER_CUBIC));
    ASSERT_EQ(a.state, i == 0 ? TrackingState::kInitializing : TrackingState::kOk);
    EXPECT_EQ(a.T_odom_camera.matrix(), b.T_odom_camera.matrix());
    ASSERT_EQ(a.points.size(), b.points.size());
    for (const ObservedPoint& point : a.points) {
      EXPECT_LT(point.left_px.x(), static_cast<float>(small.width));
      EXPECT_LT(point.left_px.y(), static_cast<float>(small.height));
    }
  }
  EXPECT_EQ(of_small.camera(), small);
}

}  // namespace
}  // namespace point_line_odometry
