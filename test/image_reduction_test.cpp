#include "odometry/image_reduction.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

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

TEST(ImageReduction, SmallImagesStayAsTheyAre) {
  const StereoCamera camera = cameraOf(1242, 375);
  const ImageReduction reduction(camera, {});
  EXPECT_EQ(reduction.camera(), camera);
  const StereoImages images{cv::Mat(375, 1242, CV_8UC1), cv::Mat(375, 1242, CV_8UC1), 7};
  EXPECT_EQ(reduction.reduce(images).left.data, images.left.data);
}

TEST(ImageReduction, LargeImagesGetBelowTheLimitWhateverTheirSize) {
  for (const cv::Size& size : {cv::Size(1501, 1003), cv::Size(1920, 1080), cv::Size(3726, 1125),
                               cv::Size(3840, 2160), cv::Size(8000, 6001)}) {
    const ImageReduction reduction(cameraOf(size.width, size.height), {});
    const double megapixels = 1e-6 * reduction.camera().width * reduction.camera().height;
    EXPECT_LE(megapixels, 1.0);
    EXPECT_GT(megapixels, 0.24);
  }
}

TEST(ImageReduction, WhatACameraSeesStaysWhereItIs) {
  const StereoCamera camera = cameraOf(1921, 1083);
  const ImageReduction reduction(camera, {});
  const Eigen::Vector3d p(1.5, -0.7, 8.0);
  FrameResult result;
  result.points.resize(1);
  result.points[0].left_px = reduction.camera().projectLeft(p).cast<float>();
  result.points[0].right_px = reduction.camera().projectRight(p).cast<float>();
  result.lines.resize(1);
  result.lines[0].left_px = {result.points[0].left_px, result.points[0].right_px};
  result.unmatched_points_px = {result.points[0].left_px};
  result.unmatched_lines_px = {result.lines[0].left_px};
  result.rms_px = 0.5;
  reduction.toInputPixels(&result);
  const Eigen::Vector2f left = camera.projectLeft(p).cast<float>();
  const Eigen::Vector2f right = camera.projectRight(p).cast<float>();
  EXPECT_LT((result.points[0].left_px - left).norm(), 1e-3);
  EXPECT_LT((result.points[0].right_px - right).norm(), 1e-3);
  EXPECT_LT((result.lines[0].left_px.end - right).norm(), 1e-3);
  EXPECT_LT((result.unmatched_points_px[0] - left).norm(), 1e-3);
  EXPECT_LT((result.unmatched_lines_px[0].start - left).norm(), 1e-3);
  EXPECT_DOUBLE_EQ(result.rms_px, 1.0);
}

TEST(ImageReduction, TheOdometryTakesLargeImages) {
  const StereoCamera small = synthetic::roomCamera();
  Parameters parameters;
  parameters.tracking.max_megapixels = 1.01e-6 * small.width * small.height;
  StereoCamera large = small;
  large.width *= 3;
  large.height *= 3;
  large.fx *= 3.0;
  large.fy *= 3.0;
  large.cx = 3.0 * (small.cx + 0.5) - 0.5;
  large.cy = 3.0 * (small.cy + 0.5) - 0.5;
  StereoOdometry of_small(small, parameters);
  StereoOdometry of_large(large, parameters);
  for (int i = 0; i < 4; ++i) {
    const StereoImages images = synthetic::frame(i);
    StereoImages enlarged = images;
    for (cv::Mat* image : {&enlarged.left, &enlarged.right})
      cv::resize(*image, *image, {large.width, large.height}, 0.0, 0.0, cv::INTER_NEAREST);
    const FrameResult a = of_small.process(images);
    const FrameResult b = of_large.process(enlarged);
    ASSERT_EQ(b.state, i == 0 ? TrackingState::kInitializing : TrackingState::kOk);
    EXPECT_TRUE(b.T_odom_camera.isApprox(a.T_odom_camera, 1e-6));
    ASSERT_EQ(b.points.size(), a.points.size());
  }
  EXPECT_EQ(of_large.camera(), large);
}

}  // namespace
}  // namespace point_line_odometry
