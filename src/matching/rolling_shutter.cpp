#include "matching/rolling_shutter.h"

#include <Eigen/Geometry>
#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

#include "matching/rigid_flow.h"

namespace point_line_odometry {
namespace {

/// A displacement of the image is a polynomial of degree 3 in its coordinates; a change of the
/// disparity, one of degree 2.
constexpr int kCubic = 10;
constexpr int kQuadratic = 6;
constexpr int kCalibration = 2 * kCubic + kQuadratic;

/// 1, x, y, x^2, x y, y^2, x^3, ..., in half widths from the middle.
Eigen::Matrix<double, 1, kCubic> cubic(const Eigen::Vector2d& pixel, const StereoCamera& camera) {
  const double half_width = 0.5 * camera.width;
  const double x = pixel.x() / half_width - 1.0;
  const double y = (pixel.y() - 0.5 * camera.height) / half_width;
  Eigen::Matrix<double, 1, kCubic> terms;
  terms << 1.0, x, y, x * x, x * y, y * y, x * x * x, x * x * y, x * y * y, y * y * y;
  return terms;
}

/// What two consecutive frames say: two rows for each point. Velocities are measured, too, and
/// their noise would make the read-out too small. So they are measured twice, each time with half
/// of the points: what one half gives is the instrument for the other one (Angrist and Krueger
/// 1995).
struct Equations {
  Eigen::VectorXd y;  // residual of the rigid motion [px]
  Eigen::VectorXd x;  // its change by a read-out of one second, with the half of its points
  Eigen::VectorXd instrument;      // ... with the motions of the other half
  Eigen::MatrixXd motion;          // ... by six parameters of the motion
  Eigen::MatrixXd calibration;     // ... by the calibration's
  std::vector<std::size_t> cells;  // of the image, one for each point

  explicit Equations(Eigen::Index rows)
      : y(rows), x(rows), instrument(rows), motion(rows, 6), calibration(rows, kCalibration) {}
};

/// Residuals of the image by the displacement of both pixels and the change of the disparity.
Eigen::Matrix<double, 2, kCalibration> calibrationJacobian(const StereoCamera& camera,
                                                           const FrameMotion& motion,
                                                           const Flow& flow,
                                                           const Eigen::Vector3d& p) {
  const Eigen::Matrix<double, 2, 3> J = projectionJacobian(camera, p);
  Eigen::Matrix2d by_from = (J * motion.R).leftCols<2>();
  by_from.col(0) /= camera.fx;
  by_from.col(1) /= camera.fy;
  const auto from = cubic(flow.from_px, camera);
  const auto to = cubic(flow.to_px, camera);
  Eigen::Matrix<double, 2, kCalibration> by;
  for (int i = 0; i < kCubic; ++i) {
    by.col(i) = to[i] * Eigen::Vector2d::UnitX() - from[i] * by_from.col(0);
    by.col(kCubic + i) = to[i] * Eigen::Vector2d::UnitY() - from[i] * by_from.col(1);
  }
  by.rightCols<kQuadratic>() = J * motion.t / camera.fx * from.head<kQuadratic>();
  return by;
}

constexpr int kColumns = 6;
constexpr int kRows = 4;

/// The part of the image in which a pixel is.
std::size_t cellOf(const Eigen::Vector2d& pixel, const StereoCamera& camera) {
  const int column = static_cast<int>(pixel.x() * kColumns / camera.width);
  const int row = static_cast<int>(pixel.y() * kRows / camera.height);
  return static_cast<std::size_t>(std::clamp(row, 0, kRows - 1) * kColumns +
                                  std::clamp(column, 0, kColumns - 1));
}

/// The velocities at both frames of a step, from each half of the points.
struct Velocities {
  std::array<Twist, 2> first;
  std::array<Twist, 2> second;
};

Equations equationsOf(const FlowStep& step, const Velocities& velocities,
                      const StereoCamera& camera) {
  Equations equations(2 * static_cast<Eigen::Index>(step.flows.size()));
  const auto share = [&](const Eigen::Vector2d& pixel) {
    return (pixel.y() + 0.5) / camera.height - 0.5;
  };
  Eigen::Index row = 0;
  for (const Flow& flow : step.flows) {
    const Eigen::Vector3d p = step.motion.apply(flow);
    const auto byReadOut = [&](std::size_t half) -> Eigen::Vector2d {
      const Eigen::Vector3d before = velocities.first[half].at(flow.ray, flow.inverse_depth);
      const Eigen::Vector3d after = velocities.second[half].at(p, flow.inverse_depth);
      return projectionJacobian(camera, p) *
             (share(flow.to_px) * after - share(flow.from_px) * (step.motion.R * before));
    };
    equations.y.segment<2>(row) = flow.to_px - camera.projectLeft(p);
    equations.x.segment<2>(row) = byReadOut(flow.half);
    equations.instrument.segment<2>(row) = byReadOut(1 - flow.half);
    equations.motion.middleRows<2>(row) = motionJacobian(camera, flow, p);
    equations.calibration.middleRows<2>(row) = calibrationJacobian(camera, step.motion, flow, p);
    equations.cells.push_back(cellOf(flow.from_px, camera));
    row += 2;
  }
  return equations;
}

/// The motion of each frame is its own.
void eliminateMotion(Equations* equations) {
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(equations->motion);
  const auto eliminate = [&](auto* columns) {
    *columns -= (equations->motion * qr.solve(*columns)).eval();
  };
  eliminate(&equations->y);
  eliminate(&equations->x);
  eliminate(&equations->instrument);
  eliminate(&equations->calibration);
}

/// The calibration is common to all frames. Its terms are scaled, as motions differ in size.
void eliminateCalibration(std::vector<Equations>* all) {
  constexpr double kLeastShare = 1e-3;  // smaller combinations of terms are noise
  Eigen::Index rows = 0;
  for (const Equations& e : *all) rows += e.y.size();
  Eigen::MatrixXd terms(rows, kCalibration);
  Eigen::MatrixX3d values(rows, 3);
  Eigen::Index at = 0;
  for (const Equations& e : *all) {
    terms.middleRows(at, e.y.size()) = e.calibration;
    values.middleRows(at, e.y.size()) << e.y, e.x, e.instrument;
    at += e.y.size();
  }
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr;
  qr.setThreshold(kLeastShare);
  qr.compute(terms);
  values -= (terms * qr.solve(values)).eval();
  at = 0;
  for (Equations& e : *all) {
    e.y = values.col(0).segment(at, e.y.size());
    e.x = values.col(1).segment(at, e.y.size());
    e.instrument = values.col(2).segment(at, e.y.size());
    at += e.y.size();
  }
}

/// The read-out with its standard deviation, from the scatter of groups in which errors are alike:
/// a few consecutive frames, and parts of the image over all frames (Cameron, Gelbach and Miller
/// 2011, without the term that they subtract).
std::optional<ReadOut> commonReadOut(const std::vector<Equations>& all) {
  constexpr std::size_t kFrames = 3;
  double xx = 0.0;
  double xy = 0.0;
  for (const Equations& e : all) {
    xx += e.instrument.dot(e.x);
    xy += e.instrument.dot(e.y);
  }
  if (xx <= 0.0) return std::nullopt;
  ReadOut read_out;
  read_out.seconds = xy / xx;
  Eigen::VectorXd of_frames =
      Eigen::VectorXd::Zero(static_cast<Eigen::Index>((all.size() + kFrames - 1) / kFrames));
  Eigen::VectorXd of_cells = Eigen::VectorXd::Zero(kColumns * kRows);
  for (std::size_t k = 0; k < all.size(); ++k) {
    const Eigen::VectorXd residual = all[k].y - read_out.seconds * all[k].x;
    for (std::size_t i = 0; i < all[k].cells.size(); ++i) {
      const auto row = static_cast<Eigen::Index>(2 * i);
      const double score = all[k].instrument.segment<2>(row).dot(residual.segment<2>(row));
      of_frames[static_cast<Eigen::Index>(k / kFrames)] += score;
      of_cells[static_cast<Eigen::Index>(all[k].cells[i])] += score;
    }
  }
  read_out.sigma_s = std::sqrt(of_frames.squaredNorm() + of_cells.squaredNorm()) / xx;
  return read_out;
}

/// Drops the points that the read-out leaves far from their places.
void dropOutliers(const std::vector<Equations>& all, double read_out_s,
                  std::vector<FlowStep*>* steps) {
  for (std::size_t k = 0; k < all.size(); ++k) {
    const Eigen::VectorXd residual = all[k].y - read_out_s * all[k].x;
    std::vector<double> deviations;
    for (Eigen::Index i = 0; i < residual.size(); i += 2) {
      deviations.push_back(residual.segment<2>(i).norm());
    }
    const double most = outlierCut(deviations);
    std::vector<Flow> kept;
    for (std::size_t i = 0; i < deviations.size(); ++i) {
      if (deviations[i] <= most) kept.push_back((*steps)[k]->flows[i]);
    }
    (*steps)[k]->flows = std::move(kept);
  }
}

/// The velocity at the beginning of a step, from the mean ones of the steps around it: exact for a
/// cubic if there are four of the same duration, else for a quadratic.
Twist velocityAt(const std::vector<FlowStep>& steps, std::size_t k, std::size_t half) {
  constexpr double kInner = 7.0 / 12.0;
  constexpr double kOuter = -1.0 / 12.0;
  constexpr double kMostChange = 0.1;  // of the period
  const auto sum = [&](std::size_t a, std::size_t b, double weight) {
    const Twist first = steps[a].of_halves[half].twist(steps[a].period_s);
    const Twist second = steps[b].of_halves[half].twist(steps[b].period_s);
    return Twist{weight * (first.velocity + second.velocity),
                 weight * (first.rotation + second.rotation)};
  };
  bool four = k >= 2 && k + 1 < steps.size();
  for (std::size_t i = k - 2; four && i <= k + 1; ++i) {
    four = steps[i].known &&
           std::abs(steps[i].period_s - steps[k].period_s) < kMostChange * steps[k].period_s;
  }
  if (!four) return sum(k - 1, k, 0.5);
  const Twist inner = sum(k - 1, k, kInner);
  const Twist outer = sum(k - 2, k + 1, kOuter);
  return {inner.velocity + outer.velocity, inner.rotation + outer.rotation};
}

/// A step with the motions before and after it.
bool isBetween(const std::vector<FlowStep>& steps, std::size_t i) {
  return i > 0 && i + 1 < steps.size() && steps[i - 1].known && steps[i].known &&
         steps[i + 1].known && steps[i].flows.size() >= FlowStep::kFewestPoints / 2;
}

}  // namespace

std::optional<ReadOut> measureReadOut(const std::vector<const FollowedFrame*>& frames,
                                      const StereoCamera& camera) {
  constexpr int kRounds = 3;
  constexpr std::size_t kFewestSteps = 6;
  std::vector<FlowStep> steps;
  steps.reserve(frames.size());
  for (const FollowedFrame* frame : frames) steps.push_back(fitFlowStep(*frame, camera));
  std::optional<ReadOut> read_out;
  for (int round = 0; round < kRounds; ++round) {
    std::vector<Equations> all;
    std::vector<FlowStep*> used;
    for (std::size_t i = 0; i < steps.size(); ++i) {
      if (!isBetween(steps, i)) continue;
      Velocities velocities;
      for (std::size_t half = 0; half < 2; ++half) {
        velocities.first[half] = velocityAt(steps, i, half);
        velocities.second[half] = velocityAt(steps, i + 1, half);
      }
      all.push_back(equationsOf(steps[i], velocities, camera));
      eliminateMotion(&all.back());
      used.push_back(&steps[i]);
    }
    if (all.size() < kFewestSteps) return std::nullopt;
    eliminateCalibration(&all);
    read_out = commonReadOut(all);
    if (!read_out) return std::nullopt;
    dropOutliers(all, read_out->seconds, &used);
  }
  return read_out;
}

}  // namespace point_line_odometry
