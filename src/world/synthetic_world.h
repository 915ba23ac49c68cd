#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "dataset/imu_data.h"
#include "dataset/trajectory.h"
#include "dataset/wheel_data.h"
#include "point_line_odometry/rectification.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Options of scene, camera and motion.
struct SyntheticWorldOptions {
  std::string scene = "street";
  int seed = 1;
  double speed = 1.0;
  double rotation = 1.0;
  double frame_rate_hz = 0.0;
  int moving_objects = 0;
  double open_country = 0.0;
  double hill = 0.0;
  double repetition_m = 0.0;
  double bonnet = 0.0;
  double exposure_ev = 0.0;
  double exposure_jitter_ev = 0.0;
  double motion_blur_ms = -1.0;
  double rolling_shutter_ms = 0.0;
  double lens_blur_px = 0.5;
  double vignetting = 0.2;
  double noise = -1.0;
  double lights_out_at_s = 0.0;
  double lights_out_s = 0.0;
  double imu_offset_ms = 4.0;
  double wheel_scale_error = 0.0;
  double wheel_slip = 0.0;

  /// Motion of the left camera instead of the scene's own, at least one pose, strictly increasing
  /// stamps; between them it is interpolated, after the last one it stands still. The first pose
  /// is placed at the start of the scene's own motion.
  std::vector<StampedPose> path;

  /// Instead of the scene's own camera: K, D, R and P.
  std::optional<StereoCalibration> camera;
  bool camera_is_raw = false;  ///< its images are to be rectified
};

/// The table of the world's options for the command line, the ROS node and doc/synthetic_world.md;
/// `visit` is called as by visitParameters().
template <typename AnyOptions, typename Visitor>
void visitWorldOptions(AnyOptions& o, Visitor&& visit) {
  visit("scene", o.scene, std::vector<std::string>{"street", "indoor", "corridor", "plaster"},
        "a drive with KITTI's camera; with EuRoC's a flight through rooms, along plain walls, or "
        "fast through dark rooms of plaster");
  visit("seed", o.seed, 0, 1000000, "", "each seed gives a different world");
  visit("speed", o.speed, 0.0, 10.0, "", "factor on the scene's own; 0: sways in place");
  visit("rotation", o.rotation, 0.0, 20.0, "", "factor on the scene's own sway of the camera");
  visit("frame_rate_hz", o.frame_rate_hz, 0.0, 200.0, "Hz",
        "0: the scene's own, 10 for the street and 20 elsewhere");
  visit("moving_objects", o.moving_objects, 0, 50, "", "cars on the road (street)");
  visit("open_country", o.open_country, 0.0, 1.0, "",
        "share of the town's blocks that are meadows with a few trees instead (street)");
  visit(
      "hill", o.hill, 0.0, 1.5, "",
      "1: the road leads over a hill of 7 m under clouds before it comes to the town, with little "
      "but asphalt, lane dashes and sky in view; other values: times as high (street)");
  visit("repetition_m", o.repetition_m, 0.0, 100.0, "m",
        "the pattern of everything level, as paving and carpets, repeats after this length; 0: "
        "never");
  visit("bonnet", o.bonnet, 0.0, 1.5, "",
        "1: a worn, glossy bonnet of the robot lies in the lower part of both images, to 2.9 m "
        "ahead of the camera, and there are masks of it; other values: times as long");
  visit("exposure_ev", o.exposure_ev, -8.0, 4.0, "stops", "darker or brighter images");
  visit("exposure_jitter_ev", o.exposure_jitter_ev, 0.0, 4.0, "stops",
        "each image of either camera is darker or brighter by up to so much, as auto-exposures "
        "make them");
  visit("motion_blur_ms", o.motion_blur_ms, -1.0, 100.0, "ms",
        "exposure time; negative: the scene's own, 15 for plaster, else 0");
  visit(
      "rolling_shutter_ms", o.rolling_shutter_ms, -100.0, 100.0, "ms",
      "read-out time of a rolling shutter: rows are exposed one after the other, the middle one at "
      "the stamp; negative: from the last row up; 0: all at once (global shutter)");
  visit("lens_blur_px", o.lens_blur_px, 0.0, 5.0, "px", "standard deviation of the lens's blur");
  visit("vignetting", o.vignetting, 0.0, 1.0, "", "share of light lost in the corners");
  visit("noise", o.noise, -1.0, 50.0, "grey levels",
        "standard deviation of the sensor's noise at middle grey; negative: the scene's own, 8 "
        "for plaster, else 1.5");
  visit("lights_out_at_s", o.lights_out_at_s, 0.0, 1e6, "s", "when all lights go out");
  visit("lights_out_s", o.lights_out_s, 0.0, 1e6, "s", "for how long; 0: never");
  visit("imu_offset_ms", o.imu_offset_ms, -50.0, 50.0, "ms",
        "stamp of a sample of the IMU minus that of an image of the same instant");
  visit("wheel_scale_error", o.wheel_scale_error, -0.9, 9.0, "",
        "share by which distance and turn are too large in the odometry of the wheels");
  visit("wheel_slip", o.wheel_slip, -0.9, 9.0, "",
        "share by which they are too large, in addition, for a second once in each five seconds");
}

/// One sentence for each option that is out of its range; empty if all are fine.
std::vector<std::string> checkWorldOptions(const SyntheticWorldOptions& options);

/// A procedural world seen by a stereo camera that moves on a closed trajectory, with exact ground
/// truth. The same options give the same bytes, for any number of threads and order of calls.
class SyntheticWorld {
 public:
  /// Throws std::invalid_argument with the sentences of checkWorldOptions(), or if the path is
  /// unusable.
  explicit SyntheticWorld(const SyntheticWorldOptions& options);
  ~SyntheticWorld();
  SyntheticWorld(SyntheticWorld&&) noexcept;
  SyntheticWorld& operator=(SyntheticWorld&&) noexcept;

  /// R and P of rectified images for the street; K, D, R and P of raw ones indoors.
  const StereoCalibration& calibration() const;

  /// True if images are raw and must be rectified with calibration().
  bool needsRectification() const;

  double frameRate_hz() const;

  /// Stamp of a frame and the exact pose of the left camera (the raw one for raw images) relative
  /// to frame 0; with a rolling shutter that of the middle row. Frame 0 has stamp 0; frames never
  /// end.
  StampedPose pose(std::size_t frame) const;

  /// Number of frames until the camera has travelled `length_m` metres, at least 2.
  /// Throws std::invalid_argument if it never goes that far.
  std::size_t framesForLength(double length_m) const;

  /// Gives the samples of an IMU on the camera, from a second before frame 0 on, one at each call.
  /// The world must outlive it.
  std::function<ImuSample()> imuSamples() const;

  /// The first ones of these, until a second after a frame.
  ImuData imu(std::size_t last_frame) const;

  /// Gives the odometry of wheels under the camera, which are in every scene, from a second before
  /// frame 0 on, one sample at each call. The world must outlive it.
  std::function<OdometrySample()> wheelSamples() const;

  /// The first ones of these, until a second after a frame.
  WheelData wheels(std::size_t last_frame) const;

  /// The images of a frame, CV_8UC1, with the masks of the bonnet if there is one; uses all cores.
  StereoImages render(std::size_t frame) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace point_line_odometry
