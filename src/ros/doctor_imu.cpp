#include "ros/doctor_imu.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "geometry/se3.h"
#include "ros/doctor_lines.h"

namespace point_line_odometry {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Level = DoctorLevel;

constexpr std::size_t kFewestMotions = 10;
constexpr double kOffsetStep_s = 0.005;
constexpr double kMaxEstimated_s = 0.05;    // time offsets that are estimated online
constexpr double kGivenTolerance_s = 0.01;  // where they are not
constexpr double kTypicalBias = 0.1;        // [rad/s], each axis
constexpr double kRateNoise = 0.02;         // [rad/s], of images and gyroscope
constexpr double kLeastRate = 0.05;         // [rad/s], slower turns say nothing on axes

// What fits leaves at most this share of the rates, and what does not fit at least that.
constexpr double kFits = 0.35;
constexpr double kMisfits = 0.6;
constexpr double kClearly = 2.0;  // a better fit's residual is smaller by this factor

double seconds(std::int64_t ns) { return 1e-9 * static_cast<double>(ns); }

/// The angle about each axis since the first sample, to first order.
class AngleCurve {
 public:
  explicit AngleCurve(std::vector<ImuSample> samples) : samples_(std::move(samples)) {
    const auto bad = [](const ImuSample& s) { return !s.angular_velocity.allFinite(); };
    samples_.erase(std::remove_if(samples_.begin(), samples_.end(), bad), samples_.end());
    const auto earlier = [](const ImuSample& a, const ImuSample& b) {
      return a.stamp_ns < b.stamp_ns;
    };
    std::stable_sort(samples_.begin(), samples_.end(), earlier);
    Vector3d angle = Vector3d::Zero();
    for (std::size_t i = 0; i < samples_.size(); ++i) {
      if (i > 0) {
        angle += 0.5 * seconds(samples_[i].stamp_ns - samples_[i - 1].stamp_ns) *
                 (samples_[i].angular_velocity + samples_[i - 1].angular_velocity);
      }
      angles_.push_back(angle);
    }
  }

  /// Nothing outside the samples, and in gaps of more than 0.15 s.
  std::optional<Vector3d> at(std::int64_t stamp_ns) const {
    constexpr double kMaxGap_s = 0.15;
    const auto is_earlier = [](const ImuSample& s, std::int64_t ns) { return s.stamp_ns < ns; };
    const auto after = std::lower_bound(samples_.begin(), samples_.end(), stamp_ns, is_earlier);
    if (after == samples_.begin() || after == samples_.end()) return std::nullopt;
    const auto i = static_cast<std::size_t>(after - samples_.begin());
    const double gap_s = seconds(after->stamp_ns - (after - 1)->stamp_ns);
    if (gap_s > kMaxGap_s) return std::nullopt;
    const double share = seconds(stamp_ns - (after - 1)->stamp_ns) / gap_s;
    return (1.0 - share) * angles_[i - 1] + share * angles_[i];
  }

 private:
  std::vector<ImuSample> samples_;
  std::vector<Vector3d> angles_;
};

/// Mean rates of camera and IMU between frames, both in the camera's axes as they are given.
struct RatePair {
  Vector3d camera;
  Vector3d imu;
};

/// The 24 rotations by multiples of 90 degrees; the identity first.
std::vector<Matrix3d> axisRotations() {
  std::vector<Matrix3d> rotations;
  std::array<int, 3> order{0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs) {
      Matrix3d R = Matrix3d::Zero();
      for (int i = 0; i < 3; ++i)
        R(i, order[static_cast<std::size_t>(i)]) = (signs >> i) % 2 == 0 ? 1.0 : -1.0;
      if (R.determinant() > 0.0) rotations.push_back(R);
    }
  } while (std::next_permutation(order.begin(), order.end()));
  return rotations;
}

/// Root mean square of camera - R imu - bias, with a bias of the least sum of squares that a
/// gyroscope may have.
double residualOf(const std::vector<RatePair>& pairs, const Matrix3d& R) {
  const auto n = static_cast<double>(pairs.size());
  Vector3d mean = Vector3d::Zero();
  for (const RatePair& pair : pairs) mean += (pair.camera - R * pair.imu) / n;
  const double per_pair = kRateNoise * kRateNoise;
  const Vector3d bias =
      mean * (n / per_pair) / (n / per_pair + 1.0 / (kTypicalBias * kTypicalBias));
  const Vector3d limited = bias.cwiseMax(-3.0 * kTypicalBias).cwiseMin(3.0 * kTypicalBias);
  double sum = 0.0;
  for (const RatePair& pair : pairs) sum += (pair.camera - R * pair.imu - limited).squaredNorm();
  return std::sqrt(sum / n);
}

std::string percent(double share) { return number(100.0 * share, 0) + " %"; }

/// "x = -y, ...": along which axes of its frame in tf the axes of the IMU are.
std::string axesText(const Matrix3d& R) {
  const std::array<const char*, 3> names{"x", "y", "z"};
  std::string text;
  for (int axis = 0; axis < 3; ++axis) {
    int along = 0;
    R.col(axis).cwiseAbs().maxCoeff(&along);
    text += std::string(axis > 0 ? ", " : "") + names[static_cast<std::size_t>(axis)] + " = " +
            (R(along, axis) < 0.0 ? "-" : "") + names[static_cast<std::size_t>(along)];
  }
  return text;
}

/// Roll, pitch and yaw of static_transform_publisher.
std::string anglesText(const Matrix3d& R) {
  const double yaw = std::atan2(R(1, 0), R(0, 0));
  const double pitch = std::atan2(-R(2, 0), std::hypot(R(2, 1), R(2, 2)));
  const bool locked = std::hypot(R(2, 1), R(2, 2)) < 1e-6;
  const double roll = locked ? 0.0 : std::atan2(R(2, 1), R(2, 2));
  const double turned = locked ? std::atan2(-R(0, 1), R(1, 1)) : yaw;
  return "yaw " + number(turned, 4) + " pitch " + number(pitch, 4) + " roll " + number(roll, 4);
}

/// Samples at the limit of the range, and those that stay at the largest rate of their axis: a
/// limit that the parameter does not know.
std::size_t countSaturated(const ImuCheckFacts& facts) {
  const double range = 0.99 * facts.parameters.range_deg_s * M_PI / 180.0;
  std::array<double, 3> largest{};
  for (const ImuSample& s : facts.samples) {
    for (int i = 0; i < 3; ++i) {
      auto& most = largest[static_cast<std::size_t>(i)];
      if (std::isfinite(s.angular_velocity[i]))
        most = std::max(most, std::abs(s.angular_velocity[i]));
    }
  }
  constexpr double kFast = 1.0;        // [rad/s]
  constexpr std::size_t kPlateau = 4;  // samples
  std::size_t saturated = 0;
  std::array<std::size_t, 3> plateau{};
  for (const ImuSample& s : facts.samples) {
    bool is = s.angular_velocity.cwiseAbs().maxCoeff() > range;
    for (int i = 0; i < 3; ++i) {
      const double most = largest[static_cast<std::size_t>(i)];
      auto& length = plateau[static_cast<std::size_t>(i)];
      length = most > kFast && std::abs(s.angular_velocity[i]) >= most ? length + 1 : 0;
      is = is || length >= kPlateau;
    }
    saturated += is ? 1 : 0;
  }
  return saturated;
}

DoctorLine evaluateFit(const ImuCheckFacts& facts, const std::string& text) {
  const RateFit& fit = *facts.fit;
  const auto warn = [&](const std::string& fault, const std::string& hint) {
    return failureLine(DoctorSubject::kImu, Level::kWarn, text + "; " + fault, hint);
  };
  if (fit.rate_rad_s < kLeastRate)
    return okLine(DoctorSubject::kImu, text + "; the camera hardly turns: axes not checked");
  if (!fit.better.empty()) {
    std::string hint = "turn the IMU in tf: its axes are " + axesText(fit.better.front()) +
                       " of its frame there, " + anglesText(fit.better.front()) + " from it";
    if (fit.better.size() > 1) {
      hint += ", or one of " + std::to_string(fit.better.size() - 1) +
              " other rotations: turn the camera about two axes to tell";
    }
    return warn("its axes are wrong by a multiple of 90 degrees: rates as given leave " +
                    percent(fit.residual_rad_s / fit.rate_rad_s) +
                    " of those by the images, turned " +
                    percent(fit.best_residual_rad_s / fit.rate_rad_s),
                hint);
  }
  const double allowed_s =
      facts.parameters.estimate_time_offset ? kMaxEstimated_s : kGivenTolerance_s;
  const double expected_s =
      facts.parameters.estimate_time_offset ? 0.0 : facts.parameters.time_offset_s;
  const bool improves = fit.residual_in_time_rad_s <= kFits * fit.rate_rad_s &&
                        kClearly * fit.residual_in_time_rad_s <= fit.residual_rad_s;
  if (std::abs(fit.time_offset_s - expected_s) > allowed_s && improves) {
    return warn(
        "its stamps are " + number(1e3 * fit.time_offset_s, 0) +
            " ms later than those of the images",
        "stamp both with one clock at the time of measurement; of up to 50 ms the offset is "
        "estimated, or given as imu/time_offset_s");
  }
  if (fit.residual_rad_s > kMisfits * fit.rate_rad_s) {
    return warn(
        "its rates do not fit the images in any axes: they leave " +
            percent(fit.best_residual_rad_s / fit.rate_rad_s),
        "check that it is fixed to the camera, gives rad/s, and is stamped by the same clock");
  }
  return okLine(DoctorSubject::kImu, text + ", rates fit the images");
}

}  // namespace

std::optional<RateFit> fitRates(const std::vector<ImuSample>& samples,
                                const std::vector<ImageMotion>& motions,
                                const std::vector<std::int64_t>& to_ns,
                                const Matrix3d& R_camera_imu, const ImuParameters& parameters) {
  const AngleCurve curve(samples);
  const auto pairsAt = [&](double offset_s) {
    const auto offset_ns = static_cast<std::int64_t>(std::llround(1e9 * offset_s));
    std::vector<RatePair> pairs;
    for (std::size_t k = 0; k < motions.size(); ++k) {
      const double dt_s = seconds(to_ns[k] - motions[k].from_ns);
      const auto from = curve.at(motions[k].from_ns + offset_ns);
      const auto to = curve.at(to_ns[k] + offset_ns);
      if (!from || !to || dt_s <= 0.0) continue;
      const Vector3d camera = logSO3(motions[k].T_prev_curr.linear()) / dt_s;
      pairs.push_back({camera, R_camera_imu * (*to - *from) / dt_s});
    }
    return pairs;
  };
  const double given_s = parameters.time_offset_s;
  const std::vector<RatePair> given = pairsAt(given_s);
  if (given.size() < kFewestMotions) return std::nullopt;
  RateFit fit;
  for (const RatePair& pair : given)
    fit.rate_rad_s += pair.camera.squaredNorm() / static_cast<double>(given.size());
  fit.rate_rad_s = std::sqrt(fit.rate_rad_s);
  const double tolerated_s = parameters.estimate_time_offset ? kMaxEstimated_s : 0.0;
  // In the camera's axes a turn of the IMU's is R_camera_imu R R_camera_imu^T.
  const std::vector<Matrix3d> rotations = axisRotations();
  std::vector<double> best(rotations.size(), INFINITY);
  fit.residual_rad_s = fit.residual_in_time_rad_s = residualOf(given, Matrix3d::Identity());
  fit.time_offset_s = given_s;
  const auto steps = static_cast<int>(std::lround(RateFit::kMaxOffset_s / kOffsetStep_s));
  for (int step = -steps; step <= steps; ++step) {
    const double offset_s = step * kOffsetStep_s;
    const std::vector<RatePair> pairs = pairsAt(offset_s);
    if (pairs.size() < kFewestMotions || 2 * pairs.size() < given.size()) continue;
    for (std::size_t i = 0; i < rotations.size(); ++i) {
      const double residual =
          residualOf(pairs, R_camera_imu * rotations[i] * R_camera_imu.transpose());
      best[i] = std::min(best[i], residual);
      if (i > 0) continue;
      if (std::abs(offset_s - given_s) <= tolerated_s)
        fit.residual_rad_s = std::min(fit.residual_rad_s, residual);
      if (residual < fit.residual_in_time_rad_s) {
        fit.residual_in_time_rad_s = residual;
        fit.time_offset_s = offset_s;
      }
    }
  }
  fit.best_residual_rad_s =
      std::min(fit.residual_in_time_rad_s, *std::min_element(best.begin(), best.end()));
  const bool given_fits = fit.residual_in_time_rad_s <=
                          std::max(kFits * fit.rate_rad_s, kClearly * fit.best_residual_rad_s);
  if (given_fits || fit.best_residual_rad_s > kFits * fit.rate_rad_s) return fit;
  for (std::size_t i = 1; i < rotations.size(); ++i) {
    if (best[i] <= std::min(kFits * fit.rate_rad_s, 1.3 * fit.best_residual_rad_s + 0.005))
      fit.better.push_back(rotations[i]);
  }
  return fit;
}

DoctorLine checkImu(const ImuCheckFacts& facts) {
  if (facts.samples.empty()) {
    return failureLine(DoctorSubject::kImu, Level::kWarn, "nothing arrives on " + facts.topic,
                       "start the IMU's driver, remap imu, or leave imu/enabled false");
  }
  const auto [first, last] =
      std::minmax_element(facts.samples.begin(), facts.samples.end(),
                          [](const auto& a, const auto& b) { return a.stamp_ns < b.stamp_ns; });
  const double span_s = seconds(last->stamp_ns - first->stamp_ns);
  const double rate_hz =
      span_s > 0.0 ? static_cast<double>(facts.samples.size() - 1) / span_s : 0.0;
  const std::string text = facts.topic + ": " + std::to_string(facts.samples.size()) +
                           " samples, " + number(rate_hz, 1) + " Hz";
  const std::size_t saturated = countSaturated(facts);
  DoctorLine line;
  if (saturated > 0) {
    line =
        failureLine(DoctorSubject::kImu, Level::kWarn,
                    text + "; " + std::to_string(saturated) + " of them are saturated",
                    "raise the range in the driver, and give it as imu/range_deg_s, so that these "
                    "samples are not used");
  } else if (!facts.R_camera_imu && !facts.parameters.enabled) {
    line =
        unknownLine(DoctorSubject::kImu, text + "; tf does not know its frame, axes not checked");
  } else if (!facts.R_camera_imu) {
    line = failureLine(DoctorSubject::kImu, Level::kWarn,
                       text + "; tf does not know its frame '" + facts.frame + "'",
                       "publish a static transform of it, with static_transform_publisher");
  } else if (facts.fit) {
    line = evaluateFit(facts, text);
  } else {
    line = okLine(DoctorSubject::kImu, text + "; too few motions by the images: axes not checked");
  }
  line.values = {{"rate of the IMU [Hz]", number(rate_hz, 2)},
                 {"saturated samples", std::to_string(saturated)}};
  if (facts.fit) {
    line.values.emplace_back("rate of the camera [rad/s]", number(facts.fit->rate_rad_s, 4));
    line.values.emplace_back("difference of the IMU [rad/s]", number(facts.fit->residual_rad_s, 4));
    line.values.emplace_back("time offset [ms]", number(1e3 * facts.fit->time_offset_s, 0));
  }
  return line;
}

}  // namespace point_line_odometry
