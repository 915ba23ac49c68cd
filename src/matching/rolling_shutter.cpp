#include "matching/rolling_shutter.h"

#include <Eigen/Geometry>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "common/statistics.h"
#include "geometry/se3.h"

namespace point_line_odometry {
namespace {

constexpr double kMadToSigma = 1.4826;
constexpr double kSigmas = 3.0;  // more are outliers
constexpr std::size_t kFewestPoints = 40;

using Matrix26d = Eigen::Matrix<double, 2, 6>;

/// A displacement of the image is a polynomial of degree 3 in its coordinates; a change of the
/// disparity, one of degree 2.
constexpr int kCubic = 10;
constexpr int kQuadratic = 6;
constexpr int kCalibration = 2 * kCubic + kQuadratic;

/// How the coordinates of a point (X, Y, Z, 1 / depth) of a static scene change while a camera
/// moves: dp/dt = velocity / depth + rotation x p.
struct Twist {
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  // [baselines / s]
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();  // [rad / s]

  Eigen::Vector3d at(const Eigen::Vector3d& p, double inverse_depth) const {
    return inverse_depth * velocity + rotation.cross(p);
  }
};

Twist mean(const Twist& a, const Twist& b) {
  return {0.5 * (a.velocity + b.velocity), 0.5 * (a.rotation + b.rotation)};
}

/// A point in a frame and the next one.
struct Flow {
  Eigen::Vector3d ray;         // (X, Y, 1) in the first one
  double inverse_depth = 0.0;  // [1 / baselines]
  Eigen::Vector2d from_px;
  Eigen::Vector2d to_px;
};

/// From a frame to the next one; translation in baselines.
struct FrameMotion {
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  Eigen::Vector3d t = Eigen::Vector3d::Zero();

  Eigen::Vector3d apply(const Flow& flow) const { return R * flow.ray + flow.inverse_depth * t; }

  Twist twist(double period_s) const {
    const Eigen::Vector3d w = logSO3(R);
    return {leftJacobian(w).inverse() * t / period_s, w / period_s};
  }
};

/// Two consecutive frames.
struct Step {
  std::vector<Flow> flows;
  FrameMotion motion;
  double period_s = 0.0;
  bool known = false;  // the motion is
};

Eigen::Vector2d project(const StereoCamera& camera, const Eigen::Vector3d& p) {
  return camera.projectLeft(p);
}

/// Jacobian of the pixel by the point.
Eigen::Matrix<double, 2, 3> projectionJacobian(const StereoCamera& camera,
                                               const Eigen::Vector3d& p) {
  Eigen::Matrix<double, 2, 3> J;
  J << camera.fx / p.z(), 0.0, -camera.fx * p.x() / (p.z() * p.z()),  //
      0.0, camera.fy / p.z(), -camera.fy * p.y() / (p.z() * p.z());
  return J;
}

/// Jacobian of the pixel by a small motion after the one that is known.
Matrix26d motionJacobian(const StereoCamera& camera, const Flow& flow, const Eigen::Vector3d& p) {
  Eigen::Matrix<double, 3, 6> by_motion;
  by_motion << flow.inverse_depth * Eigen::Matrix3d::Identity(), -skew(p);
  return projectionJacobian(camera, p) * by_motion;
}

std::vector<Flow> flowsOf(const TrackedFrame& frame, const StereoCamera& camera) {
  std::vector<Flow> flows;
  for (const TrackedPoint& point : frame.points) {
    if (!point.followed()) continue;
    const Eigen::Vector2d& p = point.pixel;
    flows.push_back({{(p.x() - camera.cx) / camera.fx, (p.y() - camera.cy) / camera.fy, 1.0},
                     point.disparity / camera.fx,
                     p,
                     p + point.flow});
  }
  return flows;
}

double cutOf(std::vector<double> deviations) {
  return kSigmas * kMadToSigma * median(std::move(deviations));
}

/// Fits the motion to the flows and drops those that do not agree with it. Gauss and Newton.
void fitMotion(const StereoCamera& camera, Step* step) {
  constexpr int kRounds = 12;
  constexpr double kLeastCut_px = 1.0;  // what a rolling shutter does is to be kept
  constexpr double kNearest = 0.1;      // of a ray of length 1
  FrameMotion& motion = step->motion;
  std::vector<bool> used(step->flows.size(), true);
  for (int round = 0; round < kRounds; ++round) {
    Matrix6d H = Matrix6d::Zero();
    Vector6d g = Vector6d::Zero();
    std::vector<double> deviations;
    for (std::size_t i = 0; i < step->flows.size(); ++i) {
      const Flow& flow = step->flows[i];
      const Eigen::Vector3d p = motion.apply(flow);
      if (p.z() < kNearest) {
        deviations.push_back(HUGE_VAL);
        continue;
      }
      const Eigen::Vector2d residual = flow.to_px - project(camera, p);
      deviations.push_back(residual.norm());
      if (!used[i]) continue;
      const Matrix26d J = motionJacobian(camera, flow, p);
      H += J.transpose() * J;
      g += J.transpose() * residual;
    }
    const Vector6d change = H.ldlt().solve(g);
    if (!change.allFinite()) return;
    const Eigen::Matrix3d R = expSO3(change.tail<3>());
    motion = {R * motion.R, R * motion.t + change.head<3>()};
    const double most = std::max(kLeastCut_px, cutOf(deviations));
    for (std::size_t i = 0; i < used.size(); ++i) used[i] = deviations[i] <= most;
  }
  std::vector<Flow> kept;
  for (std::size_t i = 0; i < used.size(); ++i) {
    if (used[i]) kept.push_back(step->flows[i]);
  }
  step->flows = std::move(kept);
  step->known = step->flows.size() >= kFewestPoints;
}

/// 1, x, y, x^2, x y, y^2, x^3, ..., in half widths from the middle.
Eigen::Matrix<double, 1, kCubic> cubic(const Eigen::Vector2d& pixel, const StereoCamera& camera) {
  const double half_width = 0.5 * camera.width;
  const double x = pixel.x() / half_width - 1.0;
  const double y = (pixel.y() - 0.5 * camera.height) / half_width;
  Eigen::Matrix<double, 1, kCubic> terms;
  terms << 1.0, x, y, x * x, x * y, y * y, x * x * x, x * x * y, x * y * y, y * y * y;
  return terms;
}

/// What two consecutive frames say: two rows for each point.
struct Equations {
  Eigen::VectorXd y;               // residual of the rigid motion [px]
  Eigen::VectorXd x;               // its change by a read-out of one second
  Eigen::MatrixXd motion;          // ... by six parameters of the motion
  Eigen::MatrixXd calibration;     // ... by the calibration's
  std::vector<std::size_t> cells;  // of the image, one for each point

  explicit Equations(Eigen::Index rows)
      : y(rows), x(rows), motion(rows, 6), calibration(rows, kCalibration) {}
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

Equations equationsOf(const Step& step, const Twist& first, const Twist& second,
                      const StereoCamera& camera) {
  Equations equations(2 * static_cast<Eigen::Index>(step.flows.size()));
  const auto share = [&](const Eigen::Vector2d& pixel) {
    return (pixel.y() + 0.5) / camera.height - 0.5;
  };
  Eigen::Index row = 0;
  for (const Flow& flow : step.flows) {
    const Eigen::Vector3d p = step.motion.apply(flow);
    const Eigen::Vector3d before =
        share(flow.from_px) * (step.motion.R * first.at(flow.ray, flow.inverse_depth));
    const Eigen::Vector3d after = share(flow.to_px) * second.at(p, flow.inverse_depth);
    equations.y.segment<2>(row) = flow.to_px - project(camera, p);
    equations.x.segment<2>(row) = projectionJacobian(camera, p) * (after - before);
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
  eliminate(&equations->calibration);
}

/// The calibration is common to all frames. Its terms are scaled, as motions differ in size.
void eliminateCalibration(std::vector<Equations>* all) {
  constexpr double kLeastShare = 1e-3;  // smaller combinations of terms are noise
  Eigen::Index rows = 0;
  for (const Equations& e : *all) rows += e.y.size();
  Eigen::MatrixXd terms(rows, kCalibration);
  Eigen::MatrixX2d values(rows, 2);
  Eigen::Index at = 0;
  for (const Equations& e : *all) {
    terms.middleRows(at, e.y.size()) = e.calibration;
    values.middleRows(at, e.y.size()) << e.y, e.x;
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
    xx += e.x.squaredNorm();
    xy += e.x.dot(e.y);
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
      const double score = all[k].x.segment<2>(row).dot(residual.segment<2>(row));
      of_frames[static_cast<Eigen::Index>(k / kFrames)] += score;
      of_cells[static_cast<Eigen::Index>(all[k].cells[i])] += score;
    }
  }
  read_out.sigma_s = std::sqrt(of_frames.squaredNorm() + of_cells.squaredNorm()) / xx;
  return read_out;
}

/// Drops the points that the read-out leaves far from their places.
void dropOutliers(const std::vector<Equations>& all, double read_out_s, std::vector<Step*>* steps) {
  for (std::size_t k = 0; k < all.size(); ++k) {
    const Eigen::VectorXd residual = all[k].y - read_out_s * all[k].x;
    std::vector<double> deviations;
    for (Eigen::Index i = 0; i < residual.size(); i += 2) {
      deviations.push_back(residual.segment<2>(i).norm());
    }
    const double most = cutOf(deviations);
    std::vector<Flow> kept;
    for (std::size_t i = 0; i < deviations.size(); ++i) {
      if (deviations[i] <= most) kept.push_back((*steps)[k]->flows[i]);
    }
    (*steps)[k]->flows = std::move(kept);
  }
}

/// A step with the motions before and after it.
bool isBetween(const std::vector<Step>& steps, std::size_t i) {
  return i > 0 && i + 1 < steps.size() && steps[i - 1].known && steps[i].known &&
         steps[i + 1].known && steps[i].flows.size() >= kFewestPoints / 2;
}

}  // namespace

std::optional<ReadOut> measureReadOut(const std::vector<const TrackedFrame*>& frames,
                                      const StereoCamera& camera) {
  constexpr int kRounds = 3;
  constexpr std::size_t kFewestSteps = 6;
  std::vector<Step> steps;
  for (const TrackedFrame* frame : frames) {
    Step& step = steps.emplace_back();
    step.period_s = frame->period_s;
    const bool usable = frame->period_s > 0.0 && frame->size.height == camera.height &&
                        frame->size.width == camera.width;
    if (usable) step.flows = flowsOf(*frame, camera);
    if (step.flows.size() >= kFewestPoints) fitMotion(camera, &step);
  }
  std::optional<ReadOut> read_out;
  for (int round = 0; round < kRounds; ++round) {
    std::vector<Equations> all;
    std::vector<Step*> used;
    for (std::size_t i = 0; i < steps.size(); ++i) {
      if (!isBetween(steps, i)) continue;
      const auto twist = [&](std::size_t k) { return steps[k].motion.twist(steps[k].period_s); };
      all.push_back(equationsOf(steps[i], mean(twist(i - 1), twist(i)),
                                mean(twist(i), twist(i + 1)), camera));
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
