#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <vector>

#include "world/indoor.h"
#include "world/renderer.h"

namespace point_line_odometry::world {
namespace {

using Eigen::Vector3d;

constexpr double kFocal = 200.0;
constexpr int kWidth = 160;
constexpr int kHeight = 120;

CameraCalibration pinhole() {
  CameraCalibration camera;
  camera.width = kWidth;
  camera.height = kHeight;
  camera.K << kFocal, 0.0, 79.5, 0.0, kFocal, 59.5, 0.0, 0.0, 1.0;
  camera.P.leftCols<3>() = camera.K;
  return camera;
}

CameraCalibration distorted() {
  CameraCalibration camera = pinhole();
  camera.K(0, 0) = camera.K(1, 1) = 110.0;
  camera.D = {-0.28, 0.07, 2e-4, 2e-5};
  return camera;
}

/// A camera at the origin that looks along the world's y, z up.
Eigen::Isometry3d lookAlongY() {
  Eigen::Isometry3d T_world_camera = Eigen::Isometry3d::Identity();
  T_world_camera.linear().col(0) = Vector3d::UnitX();
  T_world_camera.linear().col(1) = -Vector3d::UnitZ();
  T_world_camera.linear().col(2) = Vector3d::UnitY();
  return T_world_camera;
}

Material plain(float albedo) {
  Material material;
  material.albedo = albedo;
  material.contrast = 0.0F;
  material.shines = true;  // so that its radiance is its albedo
  return material;
}

/// A rectangle facing the camera: from x_low to x_high and z_low to z_high.
void addScreen(double depth, const Eigen::Vector2d& x, const Eigen::Vector2d& z, float albedo,
               Scene* scene) {
  ObjectBuilder builder;
  builder.addRectangle({x(0), depth, z(0)}, {x(1) - x(0), 0.0, 0.0}, {0.0, 0.0, z(1) - z(0)},
                       plain(albedo));
  scene->place(builder.take());
}

cv::Mat view(const Scene& scene, const PixelRays& rays,
             const Eigen::Isometry3d& T_world_camera = lookAlongY()) {
  return render(scene, {}, {{&rays, T_world_camera}})[0];
}

Scene wall(float albedo) {
  Scene scene;
  addScreen(20.0, {-100.0, 100.0}, {-100.0, 100.0}, albedo, &scene);
  return scene;
}

TEST(Renderer, EveryPixelSeesTheSurfaceInFrontOfIt) {
  const cv::Mat image = view(wall(0.4F), PixelRays::ofRectifiedImage(pinhole()));
  double low = 0.0;
  double high = 0.0;
  cv::minMaxLoc(image, &low, &high);
  EXPECT_NEAR(low, 0.4, 1e-6);
  EXPECT_NEAR(high, 0.4, 1e-6);
}

TEST(Renderer, EdgesLieWhereTheCameraProjectsThem) {
  const PixelRays rays = PixelRays::ofRectifiedImage(pinhole());
  for (double x = -0.37; x < 0.4; x += 0.061) {
    Scene scene = wall(0.0F);
    addScreen(2.0, {x, 10.0}, {-10.0, 10.0}, 1.0F, &scene);
    const cv::Mat image = view(scene, rays);
    // The bright area of a row is as long as the share of its pixels that are covered.
    const double edge_px = kFocal * x / 2.0 + 79.5;
    const double covered = cv::sum(image.row(50))[0];
    EXPECT_NEAR(covered, kWidth - 0.5 - edge_px, 0.04);
  }
}

TEST(Renderer, EdgesOfADistortedImageLieWhereTheCameraProjectsThem) {
  const CameraCalibration camera = distorted();
  const PixelRays rays = PixelRays::ofRawImage(camera);
  cv::Mat K(3, 3, CV_64F);
  for (int i = 0; i < 9; ++i) K.at<double>(i / 3, i % 3) = camera.K(i / 3, i % 3);
  Scene scene = wall(0.0F);
  addScreen(2.0, {-10.0, 0.8}, {-10.0, 10.0}, 1.0F, &scene);
  const cv::Mat image = view(scene, rays);
  for (const double height : {-0.7, -0.2, 0.0, 0.4, 0.8}) {
    std::vector<cv::Point2d> edge;
    cv::projectPoints(std::vector<cv::Point3d>{{0.8, height, 2.0}}, cv::Vec3d(), cv::Vec3d(), K,
                      camera.D, edge);
    const int row = static_cast<int>(std::lround(edge[0].y));
    std::vector<cv::Point2d> neighbours;  // to follow the bent edge to the middle of the row
    cv::projectPoints(std::vector<cv::Point3d>{{0.8, height + 0.01, 2.0}}, cv::Vec3d(), cv::Vec3d(),
                      K, camera.D, neighbours);
    const double slope = (neighbours[0].x - edge[0].x) / (neighbours[0].y - edge[0].y);
    const double expected = edge[0].x + slope * (row - edge[0].y) + 0.5;
    EXPECT_NEAR(cv::sum(image.row(row))[0], expected, 0.06) << height;
  }
}

TEST(Renderer, RightCameraSeesTheDisparity) {
  const PixelRays rays = PixelRays::ofRectifiedImage(pinhole());
  Scene scene = wall(0.0F);
  addScreen(4.0, {-0.2, 10.0}, {-10.0, 10.0}, 1.0F, &scene);
  Eigen::Isometry3d T_left_right = Eigen::Isometry3d::Identity();
  T_left_right.translation().x() = 0.3;
  const std::vector<cv::Mat> images =
      render(scene, {}, {{&rays, lookAlongY()}, {&rays, lookAlongY() * T_left_right}});
  const double shift = cv::sum(images[1].row(60))[0] - cv::sum(images[0].row(60))[0];
  EXPECT_NEAR(shift, kFocal * 0.3 / 4.0, 0.06);
}

TEST(Renderer, NearOccludesFarInAnyOrder) {
  const PixelRays rays = PixelRays::ofRectifiedImage(pinhole());
  for (const bool near_first : {true, false}) {
    Scene scene = wall(0.1F);
    if (near_first) addScreen(3.0, {-0.5, 0.5}, {-0.5, 0.5}, 0.9F, &scene);
    addScreen(5.0, {-1.5, 1.5}, {-1.5, 1.5}, 0.5F, &scene);
    if (!near_first) addScreen(3.0, {-0.5, 0.5}, {-0.5, 0.5}, 0.9F, &scene);
    const cv::Mat image = view(scene, rays);
    EXPECT_NEAR(image.at<float>(60, 80), 0.9F, 1e-6);
    EXPECT_NEAR(image.at<float>(60, 80 + 45), 0.5F, 1e-6);
    EXPECT_NEAR(image.at<float>(60, 80 + 70), 0.1F, 1e-6);
  }
}

TEST(Renderer, SurfacesThatPassThroughEachOtherMeetInALine) {
  const PixelRays rays = PixelRays::ofRectifiedImage(pinhole());
  Scene scene = wall(0.0F);
  addScreen(4.0, {-10.0, 10.0}, {-10.0, 10.0}, 0.2F, &scene);
  ObjectBuilder builder;  // nearer than the screen on the left of x = 0
  builder.addRectangle({-2.0, 3.0, -10.0}, {4.0, 2.0, 0.0}, {0.0, 0.0, 20.0}, plain(0.8F));
  scene.place(builder.take());
  const cv::Mat image = view(scene, rays);
  EXPECT_NEAR(image.at<float>(60, 70), 0.8F, 1e-6);
  EXPECT_NEAR(image.at<float>(60, 90), 0.2F, 1e-6);
}

TEST(Renderer, ThinSurfacesAreNotMissed) {
  const PixelRays rays = PixelRays::ofRectifiedImage(pinhole());
  // A wire of 0.2 px: wherever it lies, it takes 20 % of a pixel's width.
  for (double x = 0.0; x < 0.01; x += 0.0013) {
    Scene scene = wall(1.0F);
    addScreen(2.0, {x, x + 0.002}, {-10.0, 10.0}, 0.0F, &scene);
    const cv::Mat image = view(scene, rays);
    EXPECT_NEAR(kWidth - cv::sum(image.row(33))[0], 0.2, 0.07);
  }
}

TEST(Renderer, BackFacesAndSurfacesBehindTheCameraAreNotDrawn) {
  const PixelRays rays = PixelRays::ofRectifiedImage(pinhole());
  Scene scene = wall(0.3F);
  addScreen(-2.0, {-10.0, 10.0}, {-10.0, 10.0}, 1.0F, &scene);
  ObjectBuilder builder;  // turned away
  builder.addRectangle({1.0, 2.0, -1.0}, {-2.0, 0.0, 0.0}, {0.0, 0.0, 2.0}, plain(1.0F));
  scene.place(builder.take());
  EXPECT_NEAR(view(scene, rays).at<float>(60, 80), 0.3F, 1e-6);
}

TEST(Renderer, AFloorThatPassesUnderTheCameraIsWhole) {
  const PixelRays rays = PixelRays::ofRectifiedImage(pinhole());
  Scene scene;
  ObjectBuilder builder;
  builder.addRectangle({-500.0, -500.0, -1.0}, {1000.0, 0.0, 0.0}, {0.0, 1000.0, 0.0},
                       plain(0.25F));
  scene.place(builder.take());
  const cv::Mat image = view(scene, rays);
  for (int row = 62; row < kHeight; ++row) {
    for (int column = 0; column < kWidth; ++column) {
      ASSERT_NEAR(image.at<float>(row, column), 0.25F, 1e-6);
    }
  }
  EXPECT_GT(image.at<float>(30, 80), 0.6F);  // sky
}

TEST(Renderer, HazeTakesContrastWithDistance) {
  const PixelRays rays = PixelRays::ofRectifiedImage(pinhole());
  Scene scene = wall(0.0F);
  scene.haze_m = 20.0;  // the wall's distance: half of the contrast is left
  EXPECT_NEAR(view(scene, rays).at<float>(60, 80), 0.4F, 0.01);
}

TEST(Renderer, LightFallsByDirection) {
  const PixelRays rays = PixelRays::ofRectifiedImage(pinhole());
  Scene scene;
  Material material = plain(0.5F);
  material.shines = false;
  ObjectBuilder builder;
  builder.addRectangle({-50.0, 10.0, -50.0}, {100.0, 0.0, 0.0}, {0.0, 0.0, 100.0}, material);
  scene.place(builder.take());
  scene.lighting = {-Vector3d::UnitY(), 0.3, 0.6};  // from behind the camera
  EXPECT_NEAR(view(scene, rays).at<float>(60, 80), 0.45F, 1e-5);
  scene.lighting.direction = Vector3d::UnitY();
  EXPECT_NEAR(view(scene, rays).at<float>(60, 80), 0.15F, 1e-5);
}

TEST(Renderer, SameBytesWhateverTheNumberOfThreads) {
  const PixelRays rays = PixelRays::ofRectifiedImage(pinhole());
  const Scene scene = makeIndoor(3);
  const View view{&rays, scene.trajectory.cameraPose(2.0, 1.0, 1.0)};
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const cv::Mat one = render(scene, {}, {view})[0];
  cv::setNumThreads(4);
  const cv::Mat four = render(scene, {}, {view})[0];
  cv::setNumThreads(threads);
  EXPECT_EQ(cv::norm(one, four, cv::NORM_INF), 0.0);
}

}  // namespace
}  // namespace point_line_odometry::world
