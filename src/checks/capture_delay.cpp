#include "checks/capture_delay.h"

#include <Eigen/Core>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <utility>

#include "common/statistics.h"

namespace point_line_odometry {
namespace {

constexpr double kMadToSigma = 1.4826;

using Terms = Eigen::Matrix<double, 1, 10>;
using Field = Eigen::Matrix<double, 10, 2>;  // coefficients of the terms: velocity [px/s]

/// A measurement y = slope x + a combination of other terms.
struct Sample {
  double y = 0.0;
  double x = 0.0;
  Eigen::RowVectorXd others;
  std::size_t frame = 0;
  std::size_t cell = 0;  ///< part of the image
};

/// Samples with the same coefficients of the other terms.
using Group = std::vector<Sample>;

/// What the other terms do not explain.
struct Residuals {
  Eigen::VectorXd y;
  Eigen::VectorXd x;

  double deviation(Eigen::Index i, double slope) const { return std::abs(y[i] - slope * x[i]); }
};

/// Eliminates the other terms (Frisch and Waugh 1933). Nothing of a group that hardly has more
/// samples than terms.
Residuals eliminateOthers(const Group& group) {
  const auto rows = static_cast<Eigen::Index>(group.size());
  if (rows == 0 || rows < 3 * group.front().others.size()) return {};
  Eigen::MatrixXd others(rows, group.front().others.size());
  Residuals residuals{Eigen::VectorXd(rows), Eigen::VectorXd(rows)};
  for (Eigen::Index i = 0; i < rows; ++i) {
    const Sample& sample = group[static_cast<std::size_t>(i)];
    others.row(i) = sample.others;
    residuals.y[i] = sample.y;
    residuals.x[i] = sample.x;
  }
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(others);
  residuals.y -= others * qr.solve(residuals.y);
  residuals.x -= others * qr.solve(residuals.x);
  return residuals;
}

/// Without the samples more than three sigma off.
Group withoutOutliers(const Group& group, const Residuals& residuals, double slope) {
  std::vector<double> deviations;
  for (Eigen::Index i = 0; i < residuals.y.size(); ++i) {
    deviations.push_back(residuals.deviation(i, slope));
  }
  const double most = 3.0 * kMadToSigma * median(deviations);
  Group kept;
  for (std::size_t i = 0; i < deviations.size(); ++i) {
    if (deviations[i] <= most) kept.push_back(group[i]);
  }
  return kept;
}

/// What the samples of one frame, or of one part of the image, tell of the slope.
struct Cluster {
  double xx = 0.0;
  double xy = 0.0;
};

/// Variance of a slope by the scatter of clusters, as errors are alike within one (Liang and Zeger
/// 1986), and that of Student's distribution: a few clusters agree by chance. Nothing if too few
/// tell the slope.
std::optional<double> varianceOf(double slope, const std::map<std::size_t, Cluster>& clusters) {
  constexpr double kFewest = 4.0;
  double xx = 0.0;
  double squares = 0.0;
  double scatter = 0.0;
  for (const auto& [index, cluster] : clusters) {
    const double deviation = cluster.xy - slope * cluster.xx;
    xx += cluster.xx;
    squares += cluster.xx * cluster.xx;
    scatter += deviation * deviation;
  }
  if (squares <= 0.0) return std::nullopt;
  const double count = xx * xx / squares;  // of clusters of one size
  if (count < kFewest) return std::nullopt;
  return scatter / (xx * xx) * count / (count - 3.0);
}

/// The slope that all groups have in common, from what the other terms do not explain of them, with
/// the scatter of frames and that of cells (Cameron, Gelbach and Miller 2011, without the term that
/// they subtract).
std::optional<CaptureDelay> slopeOf(const std::vector<Group>& groups,
                                    const std::vector<Residuals>& residuals) {
  std::map<std::size_t, Cluster> frames;
  std::map<std::size_t, Cluster> cells;
  Cluster all;
  for (std::size_t g = 0; g < groups.size(); ++g) {
    for (Eigen::Index i = 0; i < residuals[g].x.size(); ++i) {
      const Sample& sample = groups[g][static_cast<std::size_t>(i)];
      for (Cluster* cluster : {&frames[sample.frame], &cells[sample.cell], &all}) {
        cluster->xx += residuals[g].x[i] * residuals[g].x[i];
        cluster->xy += residuals[g].x[i] * residuals[g].y[i];
      }
    }
  }
  if (all.xx <= 0.0) return std::nullopt;
  const double slope = all.xy / all.xx;
  const auto by_frame = varianceOf(slope, frames);
  const auto by_cell = varianceOf(slope, cells);
  if (!by_frame || !by_cell) return std::nullopt;
  return CaptureDelay{slope, *by_frame + *by_cell};
}

/// The same without outliers.
std::optional<CaptureDelay> commonSlope(std::vector<Group> groups) {
  constexpr int kRounds = 4;
  std::vector<Residuals> residuals(groups.size());
  std::optional<CaptureDelay> delay;
  for (int round = 0; round < kRounds; ++round) {
    for (std::size_t g = 0; g < groups.size(); ++g) {
      if (delay) groups[g] = withoutOutliers(groups[g], residuals[g], delay->seconds);
      residuals[g] = eliminateOthers(groups[g]);
    }
    delay = slopeOf(groups, residuals);
    if (!delay) return std::nullopt;
  }
  return delay;
}

/// Weighted mean; two that contradict each other have greater variances than they say (Birge 1932).
std::optional<CaptureDelay> combined(const std::optional<CaptureDelay>& a,
                                     const std::optional<CaptureDelay>& b) {
  if (!a || !b) return a ? a : b;
  const double sum = a->variance + b->variance;
  if (sum <= 0.0) return a;
  const double difference = a->seconds - b->seconds;
  return CaptureDelay{
      (a->seconds * b->variance + b->seconds * a->variance) / sum,
      a->variance * b->variance / sum * std::max(1.0, difference * difference / sum)};
}

/// Terms of a motion field: quadratic in the image, and linear in the disparity with coefficients
/// that are linear in the image, as rotation and translation of a camera give (Longuet-Higgins and
/// Prazdny 1980), and its square.
Terms terms(const FollowedFrame& frame, const FollowedPoint& point) {
  constexpr double kUsualShare = 0.1;  // disparity to width: terms of similar size
  const double half_width = 0.5 * frame.size.width;
  const double x = point.pixel.x() / half_width - 1.0;
  const double y = (point.pixel.y() - 0.5 * frame.size.height) / half_width;
  const double d = point.disparity / (kUsualShare * frame.size.width);
  Terms values;
  values << 1.0, x, y, x * x, x * y, y * y, d, d * x, d * y, d * d;
  return values;
}

/// Of the velocities until the next frame; nothing if too few points are followed there.
std::optional<Field> fitField(const FollowedFrame& frame) {
  if (frame.period_s <= 0.0) return std::nullopt;
  constexpr int kRounds = 6;
  constexpr int kFewest = 40;
  constexpr double kLeastCut_px = 0.3;
  std::vector<const FollowedPoint*> points;
  for (const FollowedPoint& point : frame.points) {
    if (point.followed()) points.push_back(&point);
  }
  const std::vector<const FollowedPoint*> all = points;
  Field field;
  for (int round = 0; round < kRounds; ++round) {
    const auto rows = static_cast<Eigen::Index>(points.size());
    if (rows < kFewest) return std::nullopt;
    Eigen::Matrix<double, Eigen::Dynamic, 10> design(rows, 10);
    Eigen::MatrixX2d flows(rows, 2);
    for (Eigen::Index i = 0; i < rows; ++i) {
      design.row(i) = terms(frame, *points[static_cast<std::size_t>(i)]);
      flows.row(i) = points[static_cast<std::size_t>(i)]->flow.transpose();
    }
    field = design.colPivHouseholderQr().solve(flows);
    std::vector<double> deviations;
    for (const FollowedPoint* point : all) {
      deviations.push_back((terms(frame, *point) * field - point->flow.transpose()).norm());
    }
    const double most = std::max(kLeastCut_px, 3.0 * median(deviations));
    points.clear();
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (deviations[i] <= most) points.push_back(all[i]);
    }
  }
  return Field(field / frame.period_s);
}

/// Vertical disparities by the vertical velocities, each part of the image with a calibration error
/// of its own.
std::optional<CaptureDelay> delayByRows(const std::vector<const FollowedFrame*>& frames,
                                        const std::vector<std::optional<Field>>& fields) {
  std::vector<Group> groups(kClusters);
  for (std::size_t t = 1; t < frames.size(); ++t) {
    if (!fields[t - 1] || !fields[t]) continue;
    const FollowedFrame& frame = *frames[t];
    const Field field = 0.5 * (*fields[t - 1] + *fields[t]);
    for (const FollowedPoint& point : frame.points) {
      if (!point.matched) continue;
      const Terms by = terms(frame, point);
      Sample sample{point.vertical_disparity, by.dot(field.col(1)), Eigen::RowVectorXd(3)};
      sample.others << 1.0, by[6], by[8];
      sample.frame = t;
      sample.cell = clusterOf(point.pixel, frame.size);
      groups[sample.cell].push_back(std::move(sample));
    }
  }
  return commonSlope(std::move(groups));
}

/// Changes of the disparities by the changes of the horizontal velocities, each frame with a camera
/// motion of its own.
std::optional<CaptureDelay> delayByColumns(const std::vector<const FollowedFrame*>& frames,
                                           const std::vector<std::optional<Field>>& fields) {
  std::vector<Group> groups;
  for (std::size_t t = 1; t + 1 < frames.size(); ++t) {
    const FollowedFrame& frame = *frames[t];
    const FollowedFrame& after = *frames[t + 1];
    if (!fields[t - 1] || frame.period_s <= 0.0 || !fields[t + 1]) continue;
    const Field change = 0.5 * (*fields[t + 1] - *fields[t - 1]);
    Group group;
    for (const FollowedPoint& point : frame.points) {
      if (!point.matched || point.next < 0) continue;
      const FollowedPoint& next = after.points[static_cast<std::size_t>(point.next)];
      if (!next.matched) continue;
      const Terms by = terms(frame, point);
      Sample sample{next.disparity - point.disparity, -by.dot(change.col(0)),
                    Eigen::RowVectorXd(4)};
      sample.others << 1.0, by[9], by[7], by[8];
      sample.frame = t;
      sample.cell = clusterOf(point.pixel, frame.size);
      group.push_back(std::move(sample));
    }
    groups.push_back(std::move(group));
  }
  return commonSlope(std::move(groups));
}

}  // namespace

std::optional<CaptureDelay> measureDelay(const std::vector<const FollowedFrame*>& frames) {
  std::vector<std::optional<Field>> fields;
  for (const FollowedFrame* frame : frames) fields.push_back(fitField(*frame));
  return combined(delayByRows(frames, fields), delayByColumns(frames, fields));
}

}  // namespace point_line_odometry
