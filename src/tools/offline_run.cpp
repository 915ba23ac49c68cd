#include "tools/offline_run.h"

#include <algorithm>
#include <chrono>
#include <optional>
#include <utility>

#include "common/input_error.h"
#include "geometry/se3.h"
#include "point_line_odometry/feature_overlay.h"

namespace point_line_odometry {
namespace {

using Clock = std::chrono::steady_clock;

double elapsedMs(Clock::time_point since) {
  return std::chrono::duration<double, std::milli>(Clock::now() - since).count();
}

template <typename Sample>
void sortByStamp(std::vector<Sample>* samples) {
  std::stable_sort(samples->begin(), samples->end(),
                   [](const Sample& a, const Sample& b) { return a.stamp_ns < b.stamp_ns; });
}

}  // namespace

OfflineRun::OfflineRun(StereoSource& source, const Parameters& parameters, RecordingReplay* replay)
    : source_(source),
      odometry_(rectifiedCamera(source.calibration()), parameters),
      replay_(replay),
      parameters_(parameters) {
  if (source.needsRectification()) {
    rectifier_ = std::make_unique<StereoRectifier>(source.calibration());
  }
  if (replay == nullptr) startPriorSources();
}

void OfflineRun::startPriorSources() {
  if (parameters_.imu.enabled) {
    imu_ = source_.imu().value_or(ImuData());
    if (imu_.samples.empty()) {
      throw InputError(
          "imu/enabled is true, but the input has no samples of an IMU: set it to false");
    }
  }
  if (parameters_.wheels.enabled) {
    std::optional<WheelData> wheels = source_.wheels();
    if (!wheels) {
      throw InputError(
          "wheels/enabled is true, but the input has no odometry of wheels: set it to false, or "
          "name a bag's topic by --wheel-topic");
    }
    wheels_ = std::move(*wheels);
  }
  sortByStamp(&imu_.samples);
  sortByStamp(&wheels_.samples);
  prior_sources_.emplace(parameters_);
  prior_sources_->setCamera(source_.T_base_camera() * T_rectified_input().inverse());
}

/// Of the camera before rectification.
Eigen::Isometry3d OfflineRun::T_rectified_input() const {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  if (rectifier_) T.linear() = rectifier_->R_rectified_raw();
  return T;
}

/// The prior of the motion until a frame: of a recording, of a file, or as measured.
std::optional<MotionPrior> OfflineRun::priorOf(std::int64_t stamp_ns) {
  if (replay_ != nullptr) return replay_->priorOf(stamp_ns);
  if (priors_) {
    if (std::optional<MotionPrior> given = givenPrior(stamp_ns)) return given;
  }
  return measuredPrior(stamp_ns);
}

/// Of the file; one that begins at another stamp than that of the last frame is for the odometry to
/// refuse.
std::optional<MotionPrior> OfflineRun::givenPrior(std::int64_t stamp_ns) {
  const auto given = priors_->find(stamp_ns);
  if (given == priors_->end()) return std::nullopt;
  MotionPrior prior = given->second;
  if (prior.from_ns == last_ns_) matched_priors_.insert(stamp_ns);
  if (rectifier_) {
    const Matrix6d turn = blockRotation(rectifier_->R_rectified_raw());
    const Eigen::Isometry3d T_rectified_raw = T_rectified_input();
    prior.T_prev_curr = T_rectified_raw * prior.T_prev_curr * T_rectified_raw.inverse();
    prior.information = turn * prior.information * turn.transpose();
  }
  return prior;
}

/// By gyroscope, wheels and floor.
std::optional<MotionPrior> OfflineRun::measuredPrior(std::int64_t stamp_ns) {
  PriorSources& sources = *prior_sources_;
  const auto needs_imu = [&] { return !sources.gyroscope() || !sources.hasImuUntil(stamp_ns); };
  const auto needs_wheels = [&] { return !sources.wheels() || !sources.hasWheelsUntil(stamp_ns); };
  // A source that begins later, or has a gap, does not have the samples for this frame.
  const auto is_near = [&](const auto& sample) {
    constexpr std::int64_t kLatest_ns = 1'000'000'000;
    return sample.stamp_ns <= stamp_ns + kLatest_ns;
  };
  const Eigen::Isometry3d T_base_input = source_.T_base_camera();
  const Eigen::Isometry3d T_base_imu = T_base_input * imu_.T_imu_camera.inverse();
  for (; next_imu_sample_ < imu_.samples.size(); ++next_imu_sample_) {
    const ImuSample& sample = imu_.samples[next_imu_sample_];
    if (!is_near(sample) || !needs_imu()) break;
    sources.addImu(sample, T_base_imu);
  }
  const Eigen::Isometry3d T_base_body = T_base_input * wheels_.T_body_camera.inverse();
  for (; next_wheel_sample_ < wheels_.samples.size(); ++next_wheel_sample_) {
    const OdometrySample& sample = wheels_.samples[next_wheel_sample_];
    if (!is_near(sample) || !needs_wheels()) break;
    sources.addWheels(sample, T_base_body);
  }
  if (!last_ns_ || stamp_ns <= *last_ns_) return std::nullopt;
  return sources.takePrior(*last_ns_, stamp_ns);
}

void OfflineRun::setPriors(PriorsByStamp priors) {
  priors_ = std::move(priors);
  matched_priors_.clear();
}

std::vector<std::int64_t> OfflineRun::stamps() const {
  std::vector<std::int64_t> stamps_ns;
  for (const FrameRow& row : rows_) stamps_ns.push_back(row.pose.stamp_ns);
  return stamps_ns;
}

std::optional<PriorFileUse> OfflineRun::priorFileUse(bool left_out) const {
  if (!priors_) return std::nullopt;
  PriorFileUse use;
  for (const auto& [to_ns, prior] : *priors_) {
    if (left_out && !rows_.empty() && to_ns > rows_.back().pose.stamp_ns) break;
    ++use.rows;
    if (matched_priors_.count(to_ns) == 0) use.unmatched.push_back({prior.from_ns, to_ns});
  }
  return use;
}

std::optional<GravityCalibration> OfflineRun::gravity() const {
  if (!prior_sources_ || !prior_sources_->gravity()) return std::nullopt;
  return prior_sources_->gravity()->calibration();
}

std::optional<GyroscopeCalibration> OfflineRun::gyroscope() const {
  if (!prior_sources_ || !prior_sources_->gyroscope()) return std::nullopt;
  return prior_sources_->gyroscope()->calibration();
}

void OfflineRun::setTargetFrameTime(double target_ms) {
  budget_ = AdaptiveFeatureBudget(target_ms);
}

bool OfflineRun::step() {
  const Clock::time_point begin = Clock::now();
  std::optional<StereoImages> images = source_.next();
  if (!images) return false;
  const double decode_ms = elapsedMs(begin);
  const Clock::time_point decoded = Clock::now();
  if (rectifier_) images = rectifier_->rectify(*images);
  const double rectify_ms = rectifier_ ? elapsedMs(decoded) : 0.0;
  left_ = images->left;
  left_mask_ = images->left_mask;
  if (replay_ != nullptr) replay_->prepare(images->stamp_ns, &odometry_);
  const std::optional<MotionPrior> prior = priorOf(images->stamp_ns);
  if (prior_sources_) {
    if (const auto tilt = prior_sources_->takeTiltCorrection()) odometry_.correctTilt(*tilt);
  }
  result_ = odometry_.process(*images, prior ? &*prior : nullptr);
  if (prior_sources_) prior_sources_->update(result_);
  if (replay_ != nullptr) replay_->compare(result_);
  if (!result_.accepted()) {
    ++refused_[result_.reason];
    return true;
  }
  last_ns_ = images->stamp_ns;
  rows_.push_back({{images->stamp_ns, poseOfInputCamera(result_.T_odom_camera)},
                   result_.state,
                   result_.reason,
                   result_.counts,
                   result_.rms_px,
                   result_.times,
                   decode_ms,
                   rectify_ms,
                   budget_.budget().share,
                   uncertaintyOfInputCamera(result_),
                   result_.prior});
  point_residuals_.add(result_.point_residuals);
  line_residuals_.add(result_.line_residuals);
  adaptBudget(rectify_ms + result_.times.total_ms);
  return true;
}

void OfflineRun::adaptBudget(double frame_ms) {
  const FeatureBudget before = budget_.budget();
  if (budget_.addFrame(frame_ms, result_.by_landmarks) != before)
    odometry_.setParameters(withFeatureBudget(parameters_, budget_.budget()));
}

cv::Mat OfflineRun::draw() const { return drawFeatures(left_, result_, left_mask_); }

Eigen::Isometry3d OfflineRun::poseOfInputCamera(const Eigen::Isometry3d& T_odom_rectified) const {
  if (!rectifier_) return T_odom_rectified;
  const Eigen::Isometry3d T_rectified_raw = T_rectified_input();
  if (replay_ != nullptr) return T_odom_rectified * T_rectified_raw;
  return T_rectified_raw.inverse() * T_odom_rectified * T_rectified_raw;
}

FrameUncertainty OfflineRun::uncertaintyOfInputCamera(const FrameResult& result) const {
  FrameUncertainty u{result.pose_covariance, result.twist, result.twist_covariance,
                     result.twist_over_s};
  if (!rectifier_) return u;
  const Matrix6d turn = blockRotation(rectifier_->R_rectified_raw().transpose());
  u.twist = turn * u.twist;
  u.twist_covariance = turn * u.twist_covariance * turn.transpose();
  if (replay_ == nullptr) u.pose_covariance = turn * u.pose_covariance * turn.transpose();
  return u;
}

}  // namespace point_line_odometry
