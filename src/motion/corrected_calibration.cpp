#include "motion/corrected_calibration.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstddef>

#include "geometry/raw_camera.h"
#include "geometry/se3.h"

namespace point_line_odometry {
namespace {

/// Pixels as columns.
using Pixels = Eigen::Matrix2Xd;

constexpr std::size_t kFirstTangential = 2;  // index in D of plumb_bob and rational_polynomial

/// Change of a camera: rotation vector, fx, fy, cx, cy, and the two tangential coefficients if the
/// model has these.
class CameraChange {
 public:
  explicit CameraChange(const CameraCalibration& camera)
      : camera_(camera), has_tangential_(camera.distortion_model != "equidistant") {
    if (has_tangential_ && camera_.D.size() < 4)
      camera_.D.assign(camera_.distortion_model == "rational_polynomial" ? 8 : 5, 0.0);
    if (camera_.distortion_model.empty()) camera_.distortion_model = "plumb_bob";
  }

  int size() const { return has_tangential_ ? 9 : 7; }

  CameraCalibration apply(const Eigen::VectorXd& change) const {
    CameraCalibration changed = camera_;
    changed.R = expSO3(change.head<3>()) * camera_.R;
    changed.K(0, 0) += change[3];
    changed.K(1, 1) += change[4];
    changed.K(0, 2) += change[5];
    changed.K(1, 2) += change[6];
    if (has_tangential_) {
      changed.D[kFirstTangential] += change[7];
      changed.D[kFirstTangential + 1] += change[8];
    }
    return changed;
  }

 private:
  CameraCalibration camera_;
  bool has_tangential_;
};

Pixels gridOf(int width, int height) {
  constexpr int kColumns = 33;
  constexpr int kRows = 17;
  Pixels grid(2, kColumns * kRows);
  for (int row = 0; row < kRows; ++row) {
    for (int column = 0; column < kColumns; ++column) {
      grid.col(row * kColumns + column) << column * (width - 1.0) / (kColumns - 1),
          row * (height - 1.0) / (kRows - 1);
    }
  }
  return grid;
}

FieldSize sizeOf(const Pixels& field) {
  const Eigen::VectorXd amounts = field.colwise().norm();
  return {std::sqrt(amounts.squaredNorm() / static_cast<double>(amounts.size())),
          amounts.maxCoeff()};
}

Eigen::VectorXd flattened(const Pixels& pixels) {
  return Eigen::Map<const Eigen::VectorXd>(pixels.data(), pixels.size());
}

/// A step of each parameter for numeric derivatives: about a hundredth of a pixel at the side of
/// the image.
Eigen::VectorXd differenceSteps(const CameraCalibration& camera, int size) {
  constexpr double kStep_px = 0.01;
  const double by_angle = kStep_px / camera.K(0, 0);
  Eigen::VectorXd steps = Eigen::VectorXd::Constant(size, by_angle);
  steps.segment<4>(3).setConstant(kStep_px);
  return steps;
}

/// Weights of the residuals of a grid: 1 in the middle columns of the image and a tenth at its
/// sides, where fewer points are, and what no parameter expresses is largest (x^4).
Eigen::VectorXd residualWeights(const Pixels& grid) {
  constexpr double kDecrease = 0.9;
  const double half_px = 0.5 * grid.row(0).maxCoeff();
  Eigen::VectorXd weights(2 * grid.cols());
  for (Eigen::Index i = 0; i < grid.cols(); ++i) {
    const double x = grid(0, i) / half_px - 1.0;
    weights.segment<2>(2 * i).setConstant(1.0 - kDecrease * x * x);
  }
  return weights;
}

/// Gauss-Newton, in parameters that each move pixels by 1 px (root mean square). They are kept near
/// the given camera: what hardly differs over this field of view, such as a shift of the principal
/// point and a rotation, would take large opposite values.
Eigen::VectorXd fit(const CameraChange& change, const Eigen::VectorXd& steps,
                    const Pixels& corrected, const Pixels& raw, const Eigen::VectorXd& weights) {
  constexpr int kIterations = 10;
  constexpr double kDamping = 1e-6;
  const auto residualOf = [&](const Eigen::VectorXd& x) {
    return flattened(rawPixels(change.apply(x), corrected) - raw).cwiseProduct(weights).eval();
  };
  Eigen::VectorXd x = Eigen::VectorXd::Zero(change.size());
  for (int k = 0; k < kIterations; ++k) {
    const Eigen::VectorXd r = residualOf(x);
    Eigen::MatrixXd J(r.size(), x.size());
    for (Eigen::Index i = 0; i < x.size(); ++i) {
      Eigen::VectorXd ahead = x;
      Eigen::VectorXd behind = x;
      ahead[i] += steps[i];
      behind[i] -= steps[i];
      J.col(i) = (residualOf(ahead) - residualOf(behind)) / (2.0 * steps[i]);
    }
    const double count = static_cast<double>(raw.cols());
    const Eigen::VectorXd unit = (J.colwise().squaredNorm() / count).cwiseSqrt().cwiseInverse();
    const Eigen::MatrixXd scaled = J * unit.asDiagonal();
    const Eigen::MatrixXd damping =
        kDamping * count * Eigen::MatrixXd::Identity(x.size(), x.size());
    const Eigen::VectorXd y = x.cwiseQuotient(unit);
    const Eigen::VectorXd step =
        (scaled.transpose() * scaled + damping).ldlt().solve(-scaled.transpose() * r - damping * y);
    x += unit.cwiseProduct(step);
  }
  return x;
}

}  // namespace

CorrectedCalibration correctedCalibration(const StereoCalibration& calibration,
                                          const RightDisplacement& displacement) {
  const StereoRectifier usable(calibration);  // throws if it is not
  const Pixels grid = gridOf(usable.camera().width, usable.camera().height);
  Pixels corrected(2, grid.cols());
  for (Eigen::Index i = 0; i < grid.cols(); ++i) corrected.col(i) = displacement(grid.col(i));
  const CameraChange change(calibration.right);
  const Pixels raw = rawPixels(change.apply(Eigen::VectorXd::Zero(change.size())), grid);
  const Eigen::VectorXd x = fit(change, differenceSteps(calibration.right, change.size()),
                                corrected, raw, residualWeights(grid));
  const CameraCalibration right = change.apply(x);
  CorrectedCalibration result{calibration, sizeOf(corrected - grid), {}};
  result.remaining = sizeOf(rawPixels(right, corrected) - raw);
  if (result.remaining.rms_px < result.change.rms_px) {
    result.calibration.right = right;
  } else {
    result.remaining = result.change;
  }
  return result;
}

}  // namespace point_line_odometry
