#include "checks/read_out.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <opencv2/core.hpp>
#include <stdexcept>

#include "checks/rigid_flow.h"
#include "geometry/raw_camera.h"

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

/// What two consecutive frames say: two rows for each inlier.
struct Equations {
  Eigen::VectorXd y;               // residual of the motion [px]
  Eigen::VectorXd x;               // its change by a read-out of one second
  Eigen::MatrixXd motion;          // ... by six parameters of the motion
  Eigen::MatrixXd calibration;     // ... by the calibration's
  std::vector<std::size_t> cells;  // of the image, one for each point

  explicit Equations(Eigen::Index rows)
      : y(rows), x(rows), motion(rows, 6), calibration(rows, kCalibration) {}
};

/// Residuals of the image by the displacement of both pixels and the change of the disparity.
Eigen::Matrix<double, 2, kCalibration> calibrationJacobian(const StereoCamera& camera,
                                                           const FlowStep& step, const Flow& flow,
                                                           const Eigen::Vector3d& xyz) {
  const Eigen::Matrix<double, 2, 3> J = projectionJacobian(camera, xyz);
  Eigen::Matrix2d by_from = (J * step.R).leftCols<2>();
  by_from.col(0) /= camera.fx;
  by_from.col(1) /= camera.fy;
  const auto from = cubic(flow.from_px, camera);
  const auto to = cubic(flow.to_px, camera);
  Eigen::Matrix<double, 2, kCalibration> by;
  for (int i = 0; i < kCubic; ++i) {
    by.col(i) = to[i] * Eigen::Vector2d::UnitX() - from[i] * by_from.col(0);
    by.col(kCubic + i) = to[i] * Eigen::Vector2d::UnitY() - from[i] * by_from.col(1);
  }
  by.rightCols<kQuadratic>() = J * step.t / camera.fx * from.head<kQuadratic>();
  return by;
}

Equations equationsOf(const FlowStep& step, double read_out_s, const StereoCamera& camera) {
  const auto inliers = std::count_if(step.flows.begin(), step.flows.end(),
                                     [](const Flow& flow) { return flow.inlier; });
  Equations equations(2 * inliers);
  Eigen::Index row = 0;
  for (const Flow& flow : step.flows) {
    if (!flow.inlier) continue;
    const Eigen::Vector3d xyz = step.predict(flow, read_out_s);
    equations.y.segment<2>(row) = flow.to_px - camera.projectLeft(xyz);
    equations.x.segment<2>(row) = projectionJacobian(camera, xyz) * step.byReadOut(flow);
    equations.motion.middleRows<2>(row) = motionJacobian(camera, flow, xyz);
    equations.calibration.middleRows<2>(row) = calibrationJacobian(camera, step, flow, xyz);
    equations.cells.push_back(clusterOf(flow.from_px, {camera.width, camera.height}));
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

/// The calibration is common to all frames, and hardly wrong: without this knowledge, what an even
/// motion does to rows is explained by displacements of many pixels.
void eliminateCalibration(std::vector<Equations>* all) {
  constexpr double kNoise_px = 0.1;         // of a flow
  constexpr double kDisplacement_px = 0.1;  // of each term
  constexpr double kWeight = kNoise_px * kNoise_px / (kDisplacement_px * kDisplacement_px);
  Eigen::MatrixXd H = kWeight * Eigen::MatrixXd::Identity(kCalibration, kCalibration);
  Eigen::MatrixX2d g = Eigen::MatrixX2d::Zero(kCalibration, 2);
  for (const Equations& e : *all) {
    H += e.calibration.transpose() * e.calibration;
    g.col(0) += e.calibration.transpose() * e.y;
    g.col(1) += e.calibration.transpose() * e.x;
  }
  const Eigen::MatrixX2d terms = H.ldlt().solve(g);
  for (Equations& e : *all) {
    e.y -= e.calibration * terms.col(0);
    e.x -= e.calibration * terms.col(1);
  }
}

/// The change of the read-out with its standard deviation, from the scatter of groups in which
/// errors are alike: a few consecutive frames, and parts of the image over all frames (Cameron,
/// Gelbach and Miller 2011, without the term that they subtract), and from an error of flows that
/// would look exactly like it.
std::optional<ReadOut> commonChange(const std::vector<Equations>& all) {
  constexpr std::size_t kFrames = 3;
  constexpr double kAlike_px = 0.02;  // root mean square; it is less in built-in scenes
  double xx = 0.0;
  double xy = 0.0;
  double rows = 0.0;
  for (const Equations& e : all) {
    xx += e.x.squaredNorm();
    xy += e.x.dot(e.y);
    rows += static_cast<double>(e.x.size());
  }
  if (xx <= 0.0) return std::nullopt;
  ReadOut change;
  change.seconds = xy / xx;
  Eigen::VectorXd of_frames =
      Eigen::VectorXd::Zero(static_cast<Eigen::Index>((all.size() + kFrames - 1) / kFrames));
  Eigen::VectorXd of_cells = Eigen::VectorXd::Zero(kClusters);
  for (std::size_t k = 0; k < all.size(); ++k) {
    const Eigen::VectorXd residual = all[k].y - change.seconds * all[k].x;
    for (std::size_t i = 0; i < all[k].cells.size(); ++i) {
      const auto row = static_cast<Eigen::Index>(2 * i);
      const double score = all[k].x.segment<2>(row).dot(residual.segment<2>(row));
      of_frames[static_cast<Eigen::Index>(k / kFrames)] += score;
      of_cells[static_cast<Eigen::Index>(all[k].cells[i])] += score;
    }
  }
  const double scatter = (of_frames.squaredNorm() + of_cells.squaredNorm()) / (xx * xx);
  change.sigma_s = std::sqrt(scatter + kAlike_px * kAlike_px * rows / xx);
  return change;
}

/// The velocity at the beginning of a step, from the mean ones of the steps around it: exact for a
/// cubic if there are four of the same duration, else for a quadratic.
Twist velocityAt(const std::vector<FlowStep>& steps, std::size_t k) {
  constexpr double kInner = 7.0 / 12.0;
  constexpr double kOuter = -1.0 / 12.0;
  constexpr double kMostChange = 0.1;  // of the period
  const auto sum = [&](std::size_t a, std::size_t b, double weight) {
    const Twist first = steps[a].meanTwist();
    const Twist second = steps[b].meanTwist();
    return Twist{weight * (first.velocity + second.velocity),
                 weight * (first.rotation + second.rotation)};
  };
  bool four = k >= 2 && k + 1 < steps.size();
  for (std::size_t i = k - 2; four && i <= k + 1; ++i) {
    four = steps[i].known &&
           std::abs(steps[i].period_s - steps[k].period_s) < kMostChange * steps[k].period_s;
  }
  if (!four) {
    const double share = steps[k].period_s / (steps[k - 1].period_s + steps[k].period_s);
    const Twist before = steps[k - 1].meanTwist();
    const Twist after = steps[k].meanTwist();
    return {share * before.velocity + (1.0 - share) * after.velocity,
            share * before.rotation + (1.0 - share) * after.rotation};
  }
  const Twist inner = sum(k - 1, k, kInner);
  const Twist outer = sum(k - 2, k + 1, kOuter);
  return {inner.velocity + outer.velocity, inner.rotation + outer.rotation};
}

/// The steps with a motion of their own and ones before and after; sets their velocities.
std::vector<const FlowStep*> setVelocities(std::vector<FlowStep>* steps) {
  std::vector<const FlowStep*> between;
  for (std::size_t i = 1; i + 1 < steps->size(); ++i) {
    FlowStep& step = (*steps)[i];
    if (!(*steps)[i - 1].known || !step.known || !(*steps)[i + 1].known) continue;
    step.first = velocityAt(*steps, i);
    step.second = velocityAt(*steps, i + 1);
    between.push_back(&step);
  }
  return between;
}

/// The rows of pixels as shares of the read-out.
std::vector<double> rowsOf(const Eigen::Matrix2Xd& pixels, const CameraCalibration& left) {
  Eigen::Matrix2Xd raw = pixels;
  try {
    raw = rawPixels(left, pixels);
  } catch (const std::invalid_argument&) {  // only P is given: the images are rectified
  }
  std::vector<double> rows;
  rows.reserve(static_cast<std::size_t>(raw.cols()));
  for (Eigen::Index i = 0; i < raw.cols(); ++i) {
    rows.push_back((raw(1, i) + 0.5) / left.height - 0.5);
  }
  return rows;
}

/// The rectified camera; lengths are in baselines.
StereoCamera rectifiedCamera(const CameraCalibration& left) {
  StereoCamera camera;
  camera.fx = left.P(0, 0);
  camera.fy = left.P(1, 1);
  camera.cx = left.P(0, 2);
  camera.cy = left.P(1, 2);
  camera.baseline_m = 1.0;
  camera.width = left.width;
  camera.height = left.height;
  return camera;
}

FlowStep stepOf(const FollowedFrame& frame, const CameraCalibration& left,
                const StereoCamera& camera) {
  FlowStep step;
  step.period_s = frame.period_s;
  if (frame.period_s <= 0.0 || frame.size != cv::Size(camera.width, camera.height)) return step;
  for (const FollowedPoint& point : frame.points) {
    if (!point.followed()) continue;
    Flow flow;
    flow.from_px = point.pixel;
    flow.to_px = point.pixel + point.flow;
    flow.ray << (point.pixel.x() - camera.cx) / camera.fx,
        (point.pixel.y() - camera.cy) / camera.fy, 1.0;
    flow.inverse_depth = point.disparity / camera.fx;
    step.flows.push_back(flow);
  }
  const auto count = static_cast<Eigen::Index>(step.flows.size());
  Eigen::Matrix2Xd pixels(2, 2 * count);
  for (Eigen::Index i = 0; i < count; ++i) {
    pixels.col(i) = step.flows[static_cast<std::size_t>(i)].from_px;
    pixels.col(count + i) = step.flows[static_cast<std::size_t>(i)].to_px;
  }
  const std::vector<double> rows = rowsOf(pixels, left);
  for (std::size_t i = 0; i < step.flows.size(); ++i) {
    step.flows[i].from_row = rows[i];
    step.flows[i].to_row = rows[step.flows.size() + i];
  }
  return step;
}

}  // namespace

std::optional<ReadOut> measureReadOut(const std::vector<const FollowedFrame*>& frames,
                                      const CameraCalibration& left) {
  constexpr int kRounds = 5;
  constexpr std::size_t kFewestSteps = 6;
  const StereoCamera camera = rectifiedCamera(left);
  std::vector<FlowStep> steps;
  steps.reserve(frames.size());
  for (const FollowedFrame* frame : frames) steps.push_back(stepOf(*frame, left, camera));
  ReadOut read_out;
  for (int round = 0; round < kRounds; ++round) {
    for (FlowStep& step : steps) fitMotion(camera, read_out.seconds, &step);
    std::vector<Equations> all;
    for (const FlowStep* step : setVelocities(&steps)) {
      all.push_back(equationsOf(*step, read_out.seconds, camera));
      eliminateMotion(&all.back());
    }
    if (all.size() < kFewestSteps) return std::nullopt;
    eliminateCalibration(&all);
    const std::optional<ReadOut> change = commonChange(all);
    if (!change) return std::nullopt;
    read_out = {read_out.seconds + change->seconds, change->sigma_s};
  }
  return read_out;
}

}  // namespace point_line_odometry
