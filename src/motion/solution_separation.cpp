#include "motion/solution_separation.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstddef>

namespace point_line_odometry {
namespace {

// Parts are squares of an eighth of the image's width, and upright strips of that width: edges of
// walls, doors and poles. They overlap by half.
constexpr double kColumns = 16.0;  // cells in a row of the image
constexpr int kCellsOfPart = 2;

constexpr double kLeastLeverage = 0.9;  // nearly an axis by itself (all matches have 6)
constexpr int kLeastOthers = 2;         // matches for each one in the part

// Squared deviation of the estimate without a part, in six axes, that is exceeded by chance once
// in a hundred parts.
constexpr double kUnlikely = 16.8;

}  // namespace

SolutionSeparation::Sums& SolutionSeparation::Sums::operator+=(const Sums& other) {
  information += other.information;
  gradient += other.gradient;
  num_matches += other.num_matches;
  return *this;
}

SolutionSeparation::SolutionSeparation(const StereoCamera& camera)
    : cell_px_(camera.width / kColumns),
      size_(static_cast<int>(kColumns),
            std::max(1, static_cast<int>(std::ceil(camera.height / cell_px_)))),
      cells_(static_cast<std::size_t>(size_.prod())) {}

void SolutionSeparation::add(const Eigen::Vector2d& left_px, const Matrix6d& information,
                             const Vector6d& gradient) {
  const Eigen::Array2i cell = (left_px / cell_px_)
                                  .array()
                                  .floor()
                                  .max(0.0)
                                  .min((size_.array() - 1).cast<double>())
                                  .cast<int>();
  const Sums match{information, gradient, 1};
  cells_[static_cast<std::size_t>(cell.y() * size_.x() + cell.x())] += match;
  whole_ += match;
}

SolutionSeparation::Sums SolutionSeparation::sumOf(const Eigen::AlignedBox2i& cells) const {
  Sums sum;
  for (int y = cells.min().y(); y < cells.max().y(); ++y) {
    for (int x = cells.min().x(); x < cells.max().x(); ++x)
      sum += cells_[static_cast<std::size_t>(y * size_.x() + x)];
  }
  return sum;
}

/// The residuals' gradients of the part, of the others and of the prior add up to zero: the step of
/// the others is the inverse of their information times the part's gradient.
double SolutionSeparation::separation(const Sums& part) const {
  if (part.num_matches == 0 || (1 + kLeastOthers) * part.num_matches > whole_.num_matches)
    return 0.0;
  const Eigen::LLT<Matrix6d> others(whole_.information - part.information);
  if (others.info() != Eigen::Success) return 0.0;  // they do not determine the motion
  return part.gradient.dot(others.solve(part.gradient));
}

std::optional<Eigen::AlignedBox2d> SolutionSeparation::mostSeparated() const {
  const Eigen::LLT<Matrix6d> root(whole_.information);
  if (root.info() != Eigen::Success) return std::nullopt;
  const Matrix6d covariance = root.solve(Matrix6d::Identity());
  double most = kUnlikely;
  std::optional<Eigen::AlignedBox2i> found;
  const auto tryPart = [&](const Eigen::AlignedBox2i& cells) {
    const Sums part = sumOf(cells);
    if (covariance.cwiseProduct(part.information).sum() < kLeastLeverage) return;
    const double separated = separation(part);
    if (!(separated > most)) return;
    most = separated;
    found = cells;
  };
  for (int x = 0; x + kCellsOfPart <= size_.x(); ++x) {
    tryPart({Eigen::Vector2i(x, 0), Eigen::Vector2i(x + kCellsOfPart, size_.y())});
    for (int y = 0; y + kCellsOfPart <= size_.y(); ++y) {
      const Eigen::Vector2i corner(x, y);
      tryPart({corner, corner + Eigen::Vector2i::Constant(kCellsOfPart)});
    }
  }
  if (!found) return std::nullopt;
  return Eigen::AlignedBox2d(cell_px_ * found->min().cast<double>(),
                             cell_px_ * found->max().cast<double>());
}

}  // namespace point_line_odometry
