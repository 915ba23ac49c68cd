#include "ros/played_camera.h"

#include <Eigen/Geometry>
#include <functional>
#include <utility>

namespace point_line_odometry {
namespace {

/// Focal length and principal point [px].
struct Pinhole {
  double f = 0.0;
  double cx = 0.0;
  double cy = 0.0;
};

CameraCalibration camera(int width, int height, const Pinhole& pinhole, std::string model,
                         std::vector<double> D) {
  CameraCalibration result;
  result.width = width;
  result.height = height;
  result.K << pinhole.f, 0.0, pinhole.cx, 0.0, pinhole.f, pinhole.cy, 0.0, 0.0, 1.0;
  result.distortion_model = std::move(model);
  result.D = std::move(D);
  result.P.leftCols<3>() = result.K;
  return result;
}

/// A pair whose raw and rectified images are seen through the same K.
StereoCalibration pairOf(const CameraCalibration& left, double baseline_m) {
  StereoCalibration pair{left, left};
  pair.right.P(0, 3) = -left.P(0, 0) * baseline_m;
  return pair;
}

PlayedCamera::Side side(const std::string& image, const std::string& info,
                        const std::string& frame) {
  return {image, info, frame, frame};
}

/// The D4xx' imagers are rectified in the camera. The driver gives the camera_info of the right one
/// the frame of the left one.
PlayedCamera realsenseD4xx() {
  PlayedCamera played;
  played.base_frame = "camera_link";
  played.sides = {side("/camera/infra1/image_rect_raw", "/camera/infra1/camera_info",
                       "camera_infra1_optical_frame"),
                  side("/camera/infra2/image_rect_raw", "/camera/infra2/camera_info",
                       "camera_infra2_optical_frame")};
  played.sides[1].info_frame = played.sides[0].frame;
  played.encoding = "mono8";
  played.frame_rate_hz = 30.0;
  played.calibration = pairOf(
      camera(640, 480, {382.6, 320.8, 237.9}, "plumb_bob", std::vector<double>(5, 0.0)), 0.05);
  return played;
}

/// HD720 published at half the size (img_downsample_factor).
PlayedCamera zed() {
  PlayedCamera played;
  played.base_frame = "base_link";
  played.sides = {side("/zed/zed_node/left/image_rect_gray", "/zed/zed_node/left/camera_info",
                       "zed_left_camera_optical_frame"),
                  side("/zed/zed_node/right/image_rect_gray", "/zed/zed_node/right/camera_info",
                       "zed_right_camera_optical_frame")};
  played.encoding = "mono8";
  played.frame_rate_hz = 15.0;
  played.calibration = pairOf(
      camera(640, 360, {338.2, 321.4, 179.1}, "plumb_bob", std::vector<double>(5, 0.0)), 0.12);
  return played;
}

/// The camera_info has the coefficients of the raw images, the images are rectified. The stamps of
/// left and right are of two messages of the device.
PlayedCamera oakD() {
  PlayedCamera played;
  played.base_frame = "oak-d_frame";
  const std::string node = "/stereo_inertial_publisher/";
  played.sides = {
      side(node + "left/image_rect", node + "left/camera_info", "oak_left_camera_optical_frame"),
      side(node + "right/image_rect", node + "right/camera_info",
           "oak_right_camera_optical_frame")};
  played.encoding = "mono8";
  played.frame_rate_hz = 15.0;
  played.right_stamp_offset_s = 0.0005;
  played.calibration = pairOf(camera(640, 400, {399.5, 318.2, 201.6}, "rational_polynomial",
                                     {-1.2, 3.1, 0.0004, -0.0006, 8.7, -1.3, 3.4, 8.2}),
                              0.075);
  return played;
}

PlayedCamera mynteye() {
  PlayedCamera played;
  played.base_frame = "mynteye_link";
  played.sides = {side("/mynteye/left_rect/image_rect", "/mynteye/left_rect/camera_info",
                       "mynteye_left_rect_frame"),
                  side("/mynteye/right_rect/image_rect", "/mynteye/right_rect/camera_info",
                       "mynteye_right_rect_frame")};
  played.encoding = "mono8";
  played.frame_rate_hz = 25.0;
  played.calibration = pairOf(
      camera(752, 480, {362.1, 377.5, 238.6}, "plumb_bob", std::vector<double>(5, 0.0)), 0.12);
  return played;
}

/// Two imagers in one image of a UVC camera, calibrated as config/cameras/stereo_usb_*.yaml have
/// it.
PlayedCamera stereoUsb() {
  PlayedCamera played;
  played.base_frame = "base_link";
  played.sides = {side("/usb_cam/image_raw", "", "usb_cam"), side("", "", "usb_cam_right")};
  played.side_by_side = true;
  played.encoding = "rgb8";
  played.frame_rate_hz = 30.0;
  played.raw = true;
  played.calibration = pairOf(
      camera(640, 480, {420.0, 318.0, 243.0}, "plumb_bob", {-0.31, 0.11, 0.0002, -0.0001, 0.0}),
      0.06);
  return played;
}

/// Two fisheye lenses; the camera_info has P = K, with which the rectified images show 112 degrees.
PlayedCamera t265Fisheye() {
  PlayedCamera played;
  played.base_frame = "camera_link";
  played.sides = {side("/camera/fisheye1/image_raw", "/camera/fisheye1/camera_info",
                       "camera_fisheye1_optical_frame"),
                  side("/camera/fisheye2/image_raw", "/camera/fisheye2/camera_info",
                       "camera_fisheye2_optical_frame")};
  played.sides[1].info_frame = played.sides[0].frame;
  played.encoding = "mono8";
  played.frame_rate_hz = 30.0;
  played.raw = true;
  played.calibration = pairOf(
      camera(848, 800, {285.9, 419.6, 401.3}, "equidistant", {-0.0072, 0.0443, -0.0418, 0.0078}),
      0.064);
  return played;
}

using Make = PlayedCamera (*)();

const std::vector<std::pair<std::string, Make>>& table() {
  static const std::vector<std::pair<std::string, Make>> cameras{{"realsense_d4xx", realsenseD4xx},
                                                                 {"zed", zed},
                                                                 {"oak_d", oakD},
                                                                 {"mynteye", mynteye},
                                                                 {"stereo_usb", stereoUsb},
                                                                 {"t265_fisheye", t265Fisheye}};
  return cameras;
}

}  // namespace

std::vector<std::string> playedCameraNames() {
  std::vector<std::string> names;
  for (const auto& [name, make] : table()) names.push_back(name);
  return names;
}

std::optional<PlayedCamera> playedCamera(const std::string& name) {
  for (const auto& [known, make] : table()) {
    if (known == name) return make();
  }
  return std::nullopt;
}

}  // namespace point_line_odometry
