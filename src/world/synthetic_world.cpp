#include "world/synthetic_world.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core/utility.hpp>
#include <optional>
#include <stdexcept>

#include "common/join.h"
#include "common/parameter_checker.h"
#include "geometry/camera_axes.h"
#include "world/bonnet.h"
#include "world/corridor.h"
#include "world/imu.h"
#include "world/indoor.h"
#include "world/plaster.h"
#include "world/random.h"
#include "world/renderer.h"
#include "world/sensor.h"
#include "world/street.h"
#include "world/wheels.h"

namespace point_line_odometry {
namespace {

using world::PixelRays;

/// The rectified pair of KITTI's sequence 00.
StereoCalibration kittiCalibration() {
  CameraCalibration left;
  left.width = 1241;
  left.height = 376;
  left.K << 718.856, 0.0, 607.1928, 0.0, 718.856, 185.2157, 0.0, 0.0, 1.0;
  left.D.assign(5, 0.0);
  left.P.leftCols<3>() = left.K;
  CameraCalibration right = left;
  right.P(0, 3) = -386.1448;
  return {left, right};
}

CameraCalibration rawCamera(const std::array<double, 4>& intrinsics, const std::vector<double>& D) {
  CameraCalibration camera;
  camera.width = 752;
  camera.height = 480;
  camera.K << intrinsics[0], 0.0, intrinsics[2], 0.0, intrinsics[1], intrinsics[3], 0.0, 0.0, 1.0;
  camera.D = D;
  return camera;
}

/// Pose of the left camera of EuRoC's micro air vehicle in its IMU.
Eigen::Matrix4d eurocLeftInImu() {
  Eigen::Matrix4d T_body_left;
  T_body_left << 0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975,
      0.999557249008, 0.0149672133247, 0.025715529948, -0.064676986768, -0.0257744366974,
      0.00375618835797, 0.999660727178, 0.00981073058949, 0.0, 0.0, 0.0, 1.0;
  return T_body_left;
}

/// The raw pair of EuRoC's micro air vehicle.
StereoCalibration eurocCalibration() {
  const StereoCalibration raw = {
      rawCamera({458.654, 457.296, 367.215, 248.375},
                {-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0.0}),
      rawCamera({457.587, 456.134, 379.999, 255.238},
                {-0.28368365, 0.07451284, -0.00010473, -3.55590700e-05, 0.0})};
  const Eigen::Matrix4d T_body_left = eurocLeftInImu();
  Eigen::Matrix4d T_body_right;
  T_body_right << 0.0125552670891, -0.999755099723, 0.0182237714554, -0.0198435579556,
      0.999598781151, 0.0130119051815, 0.0251588363115, 0.0453689425024, -0.0253898008918,
      0.0179005838253, 0.999517347078, 0.00786212447038, 0.0, 0.0, 0.0, 1.0;
  Eigen::Isometry3d T_right_left(T_body_right.inverse() * T_body_left);
  T_right_left.linear() = Eigen::Quaterniond(T_right_left.linear()).normalized().matrix();
  return rectifyCalibration(raw, T_right_left);
}

StereoCalibration calibrationOf(const SyntheticWorldOptions& options) {
  if (options.camera) return *options.camera;
  return options.scene == "street" ? kittiCalibration() : eurocCalibration();
}

world::Scene makeScene(const SyntheticWorldOptions& options) {
  const std::uint32_t seed = world::hash(0x5eed, static_cast<std::uint32_t>(options.seed));
  if (options.scene == "street") {
    return world::makeStreet(seed, {options.moving_objects, options.open_country, options.hill});
  }
  if (options.scene == "indoor") return world::makeIndoor(seed);
  if (options.scene == "plaster") return world::makePlaster(seed);
  return world::makeCorridor(seed);
}

/// Linear in position and angle between the two poses around a time; constant outside.
Eigen::Isometry3d interpolate(const std::vector<StampedPose>& path, double time_s) {
  const auto stamp = static_cast<double>(path.front().stamp_ns) + time_s * 1e9;
  const auto after = std::upper_bound(
      path.begin(), path.end(), stamp,
      [](double t, const StampedPose& pose) { return t < static_cast<double>(pose.stamp_ns); });
  if (after == path.begin()) return path.front().T_world_camera;
  if (after == path.end()) return path.back().T_world_camera;
  const StampedPose& from = *(after - 1);
  const double share = (stamp - static_cast<double>(from.stamp_ns)) /
                       static_cast<double>(after->stamp_ns - from.stamp_ns);
  const Eigen::Quaterniond q_from(from.T_world_camera.linear());
  const Eigen::Quaterniond q_to(after->T_world_camera.linear());
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = q_from.slerp(share, q_to).normalized().matrix();
  pose.translation() = (1.0 - share) * from.T_world_camera.translation() +
                       share * after->T_world_camera.translation();
  return pose;
}

}  // namespace

std::vector<std::string> checkWorldOptions(const SyntheticWorldOptions& options) {
  ParameterChecker checker;
  visitWorldOptions(options, checker);
  for (std::size_t i = 0; i < options.path.size(); ++i) {
    const StampedPose& pose = options.path[i];
    if (!pose.T_world_camera.matrix().allFinite() ||
        (i > 0 && pose.stamp_ns <= options.path[i - 1].stamp_ns)) {
      checker.errors.push_back("pose " + std::to_string(i) +
                               " of the path is not finite or not later than the one before");
      break;
    }
  }
  return checker.errors;
}

struct SyntheticWorld::Impl {
  explicit Impl(const SyntheticWorldOptions& o)
      : options(o),
        street(o.scene == "street"),
        raw(o.camera ? o.camera_is_raw : !street),
        frame_rate_hz(o.frame_rate_hz > 0.0 ? o.frame_rate_hz : (street ? 10.0 : 20.0)),
        calibration(calibrationOf(o)),
        T_left_right(poseOfRightInLeft(calibration)),
        scene(makeScene(o)),
        exposure(scene.exposure) {
    world::repeatPatterns(o.repetition_m, &scene);
    if (o.motion_blur_ms >= 0.0) exposure.shutter_ms = o.motion_blur_ms;
    if (o.noise >= 0.0) exposure.noise = o.noise;
    for (const CameraCalibration* camera : {&calibration.left, &calibration.right}) {
      rays.push_back(raw ? PixelRays::ofRawImage(*camera) : PixelRays::ofRectifiedImage(*camera));
    }
    if (o.bonnet > 0.0) {
      const int blur_px = 1 + static_cast<int>(std::ceil(3.0 * o.lens_blur_px));
      bonnet.emplace(rays, T_left_right, o.bonnet, world::hash(scene.seed, 0xb0), blur_px);
    }
  }

  /// An IMU as EuRoC's; in the street one with x ahead and z up, in the camera's place.
  Eigen::Isometry3d T_imu_left() const {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    if (!street) {
      T.matrix() = eurocLeftInImu();
      T.linear() = Eigen::Quaterniond(T.linear()).normalized().matrix();
    } else {
      T.linear() = cameraAxesInBody();
    }
    return T;
  }

  /// Wheels below and behind the camera, with x ahead and z up.
  Eigen::Isometry3d T_wheels_left() const {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.linear() = cameraAxesInBody();
    T.translation() = raw ? Eigen::Vector3d(0.2, 0.0, 0.3) : Eigen::Vector3d(0.8, 0.0, 1.65);
    return T;
  }

  bool isDark(double time_s) const {
    return time_s >= options.lights_out_at_s &&
           time_s < options.lights_out_at_s + options.lights_out_s;
  }

  double timeOf(std::size_t frame) const { return static_cast<double>(frame) / frame_rate_hz; }

  Eigen::Isometry3d T_world_left(double time_s) const {
    return T_world_left(time_s, options.rotation);
  }

  /// Pose of the left camera; `sway` scales the scene's own, without effect on a given path.
  Eigen::Isometry3d T_world_left(double time_s, double sway) const {
    if (options.path.empty()) return scene.trajectory.cameraPose(time_s, options.speed, sway);
    return scene.trajectory.cameraPose(0.0, options.speed, options.rotation) *
           options.path.front().T_world_camera.inverse() * interpolate(options.path, time_s);
  }

  /// Light of the scene that reaches some rows of both cameras at an instant.
  std::vector<cv::Mat> sceneLight(double time_s, const cv::Range& rows) const {
    const Eigen::Isometry3d T_left = T_world_left(time_s);
    const double camera_m =
        options.path.empty() ? scene.trajectory.travelled_m(time_s, options.speed) : 0.0;
    return world::render(scene, world::poseMovers(scene, time_s, camera_m),
                         {{&rays[0], T_left, rows}, {&rays[1], T_left * T_left_right, rows}});
  }

  /// The same of all rows, one after the other and the middle one at this time: in bands so narrow
  /// that the image hardly moves from one to the next.
  std::vector<cv::Mat> sceneLightRowByRow(double time_s) const {
    constexpr double kShift_px = 0.1;
    const double read_out_s = 1e-3 * options.rolling_shutter_ms;
    const int height = rays[0].height();
    const int bands =
        static_cast<int>(std::clamp(std::ceil(imageShift_px(time_s, read_out_s) / kShift_px), 1.0,
                                    static_cast<double>(height)));
    std::vector<cv::Mat> light;
    for (const PixelRays& camera : rays) light.emplace_back(height, camera.width(), CV_32FC1);
    cv::parallel_for_(cv::Range(0, bands), [&](const cv::Range& range) {
      for (int i = range.start; i < range.end; ++i) {
        const cv::Range rows(height * i / bands, height * (i + 1) / bands);
        const double share = 0.5 * (rows.start + rows.end) / height - 0.5;
        const std::vector<cv::Mat> band = sceneLight(time_s + share * read_out_s, rows);
        for (std::size_t k = 0; k < band.size(); ++k) band[k].copyTo(light[k].rowRange(rows));
      }
    });
    return light;
  }

  std::vector<cv::Mat> noLight() const {
    const cv::Size size(calibration.left.width, calibration.left.height);
    return {cv::Mat::zeros(size, CV_32FC1), cv::Mat::zeros(size, CV_32FC1)};
  }

  /// Light that reaches both cameras at an instant, or with a rolling shutter around it.
  std::vector<cv::Mat> lightAt(double time_s) const {
    std::vector<cv::Mat> light = options.rolling_shutter_ms == 0.0
                                     ? sceneLight(time_s, cv::Range::all())
                                     : sceneLightRowByRow(time_s);
    const Eigen::Matrix3d R_world_left = T_world_left(time_s).linear();
    for (std::size_t i = 0; bonnet && i < light.size(); ++i) {
      bonnet->paint(i, R_world_left, {scene.seed, static_cast<float>(scene.clouds)}, &light[i]);
    }
    return light;
  }

  /// By how much the image of an object at a typical distance moves in a time around an instant.
  double imageShift_px(double time_s, double duration_s) const {
    constexpr double kDistance_m = 4.0;
    const Eigen::Isometry3d motion =
        T_world_left(time_s - 0.5 * duration_s).inverse() * T_world_left(time_s + 0.5 * duration_s);
    const double angle = Eigen::AngleAxisd(motion.linear()).angle();
    return calibration.left.K(0, 0) * (angle + motion.translation().norm() / kDistance_m);
  }

  /// Number of samples of the exposure time: about one for each pixel of such a shift.
  int blurSteps(double time_s, double shutter_s) const {
    return static_cast<int>(std::clamp(std::ceil(imageShift_px(time_s, shutter_s)), 1.0,
                                       static_cast<double>(exposure.instants)));
  }

  SyntheticWorldOptions options;
  bool street;
  bool raw;
  double frame_rate_hz;
  StereoCalibration calibration;
  Eigen::Isometry3d T_left_right;
  world::Scene scene;
  world::Exposure exposure;
  std::vector<PixelRays> rays;
  std::optional<world::Bonnet> bonnet;
};

SyntheticWorld::SyntheticWorld(const SyntheticWorldOptions& options) {
  const std::vector<std::string> errors = checkWorldOptions(options);
  if (!errors.empty()) throw std::invalid_argument("synthetic world: " + join(errors, "; "));
  impl_ = std::make_unique<Impl>(options);
}

SyntheticWorld::~SyntheticWorld() = default;
SyntheticWorld::SyntheticWorld(SyntheticWorld&&) noexcept = default;
SyntheticWorld& SyntheticWorld::operator=(SyntheticWorld&&) noexcept = default;

const StereoCalibration& SyntheticWorld::calibration() const { return impl_->calibration; }

bool SyntheticWorld::needsRectification() const { return impl_->raw; }

double SyntheticWorld::frameRate_hz() const { return impl_->frame_rate_hz; }

StampedPose SyntheticWorld::pose(std::size_t frame) const {
  StampedPose pose;
  pose.stamp_ns = std::llround(1e9 * impl_->timeOf(frame));
  pose.T_world_camera =
      impl_->T_world_left(0.0).inverse() * impl_->T_world_left(impl_->timeOf(frame));
  return pose;
}

std::size_t SyntheticWorld::framesForLength(double length_m) const {
  constexpr std::size_t kMost = 1000000;
  const auto position = [this](std::size_t frame) {  // without the sway, which never stops
    return Eigen::Vector3d(impl_->T_world_left(impl_->timeOf(frame), 0.0).translation());
  };
  Eigen::Vector3d before = position(0);
  double travelled_m = 0.0;
  for (std::size_t frame = 1; frame < kMost; ++frame) {
    const Eigen::Vector3d here = position(frame);
    travelled_m += (here - before).norm();
    if (travelled_m >= length_m) return frame + 1;
    before = here;
  }
  throw std::invalid_argument("synthetic world: the camera goes " + std::to_string(travelled_m) +
                              " m in a million frames, less than the requested length");
}

std::function<ImuSample()> SyntheticWorld::imuSamples() const {
  constexpr double kBegin_s = -1.0;
  constexpr std::uint32_t kSalt = 0x1111;
  world::ImuModel model;
  model.time_offset_s = 1e-3 * impl_->options.imu_offset_ms;
  const Impl& impl = *impl_;
  const Eigen::Isometry3d T_left_imu = impl.T_imu_left().inverse();
  const auto T_world_imu = [&impl, T_left_imu](double time_s) {
    return Eigen::Isometry3d(impl.T_world_left(time_s) * T_left_imu);
  };
  return [sampler = world::ImuSampler(model, kBegin_s, T_world_imu,
                                      world::hash(impl.scene.seed, kSalt))]() mutable {
    return sampler.next();
  };
}

ImuData SyntheticWorld::imu(std::size_t last_frame) const {
  constexpr std::int64_t kAfter_ns = 1000000000;
  const std::int64_t end_ns = pose(last_frame).stamp_ns + kAfter_ns;
  const std::function<ImuSample()> next = imuSamples();
  ImuData data;
  data.T_imu_camera = impl_->T_imu_left();
  do {
    data.samples.push_back(next());
  } while (data.samples.back().stamp_ns < end_ns);
  return data;
}

std::function<OdometrySample()> SyntheticWorld::wheelSamples() const {
  constexpr double kBegin_s = -1.0;
  constexpr std::uint32_t kSalt = 0x3333;
  world::WheelModel model;
  model.scale_error = impl_->options.wheel_scale_error;
  model.slip = impl_->options.wheel_slip;
  const Impl& impl = *impl_;
  const Eigen::Isometry3d T_left_wheels = impl.T_wheels_left().inverse();
  const auto T_world_wheels = [&impl, T_left_wheels](double time_s) {
    return Eigen::Isometry3d(impl.T_world_left(time_s) * T_left_wheels);
  };
  return [sampler = world::WheelSampler(model, kBegin_s, T_world_wheels,
                                        world::hash(impl.scene.seed, kSalt))]() mutable {
    return sampler.next();
  };
}

WheelData SyntheticWorld::wheels(std::size_t last_frame) const {
  constexpr std::int64_t kAfter_ns = 1000000000;
  const std::int64_t end_ns = pose(last_frame).stamp_ns + kAfter_ns;
  const std::function<OdometrySample()> next = wheelSamples();
  WheelData data;
  data.T_body_camera = impl_->T_wheels_left();
  do {
    data.samples.push_back(next());
  } while (data.samples.back().stamp_ns < end_ns);
  return data;
}

StereoImages SyntheticWorld::render(std::size_t frame) const {
  const double time_s = impl_->timeOf(frame);
  const double shutter_s = 1e-3 * impl_->exposure.shutter_ms;
  const bool is_dark = impl_->isDark(time_s);
  const int steps = shutter_s > 0.0 && !is_dark ? impl_->blurSteps(time_s, shutter_s) : 1;
  std::vector<cv::Mat> light;
  if (is_dark) light = impl_->noLight();
  for (int i = 0; i < steps && !is_dark; ++i) {
    const double share = (i + 0.5) / steps - 0.5;  // of the exposure time, from its middle
    const std::vector<cv::Mat> now = impl_->lightAt(time_s + share * shutter_s);
    if (light.empty()) {
      light = now;
    } else {
      for (std::size_t k = 0; k < light.size(); ++k) light[k] += now[k];
    }
  }
  const SyntheticWorldOptions& o = impl_->options;
  const auto develop = [&](std::size_t camera) {
    const std::uint32_t seed = world::hash(impl_->scene.seed, static_cast<std::uint32_t>(frame),
                                           static_cast<std::uint32_t>(camera));
    const double jitter_ev = o.exposure_jitter_ev * world::Random(seed).uniform(-1.0, 1.0);
    const world::Sensor sensor{o.exposure_ev + jitter_ev, o.lens_blur_px, o.vignetting,
                               impl_->exposure.noise};
    const cv::Mat mean = steps > 1 ? cv::Mat(light[camera] / steps) : light[camera];
    return world::expose(mean, sensor, seed);
  };
  StereoImages images;
  images.left = develop(0);
  images.right = develop(1);
  if (impl_->bonnet) {
    images.left_mask = impl_->bonnet->mask(0);
    images.right_mask = impl_->bonnet->mask(1);
  }
  images.stamp_ns = pose(frame).stamp_ns;
  return images;
}

}  // namespace point_line_odometry
