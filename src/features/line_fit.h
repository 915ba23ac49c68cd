#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

namespace point_line_odometry {

/// Total least squares fit of a straight line to pixels, from running sums about the first pixel.
class LineFit {
 public:
  void add(const Eigen::Vector2f& p) {
    if (count_ == 0) origin_ = p;
    const Eigen::Vector2d q = (p - origin_).cast<double>();
    ++count_;
    sum_ += q;
    sum_xx_ += q.x() * q.x();
    sum_xy_ += q.x() * q.y();
    sum_yy_ += q.y() * q.y();
  }

  /// Fits the line to all pixels added; the functions below refer to the last fit. Needs two
  /// different pixels.
  void solve() {
    const Eigen::Vector2d mean = sum_ / count_;
    const double xx = sum_xx_ / count_ - mean.x() * mean.x();
    const double xy = sum_xy_ / count_ - mean.x() * mean.y();
    const double yy = sum_yy_ / count_ - mean.y() * mean.y();
    const double half_difference = 0.5 * (xx - yy);
    const double root = std::sqrt(half_difference * half_difference + xy * xy);
    const Eigen::Vector2d along = half_difference >= 0.0
                                      ? Eigen::Vector2d(half_difference + root, xy)
                                      : Eigen::Vector2d(xy, root - half_difference);
    const double norm = along.norm();
    direction_ =
        norm > 0.0 ? Eigen::Vector2f((along / norm).cast<float>()) : Eigen::Vector2f(1.0F, 0.0F);
    middle_ = origin_ + mean.cast<float>();
    normal_variance_ = std::max(0.0, 0.5 * (xx + yy) - root);
  }

  int count() const { return count_; }

  /// Mean square distance of the pixels from the line [px^2].
  double normalVariance() const { return normal_variance_; }

  /// Distance from the line [px].
  float distance(const Eigen::Vector2f& p) const {
    const Eigen::Vector2f q = p - middle_;
    return std::abs(direction_.x() * q.y() - direction_.y() * q.x());
  }

  /// Nearest point of the line.
  Eigen::Vector2f project(const Eigen::Vector2f& p) const {
    return middle_ + direction_ * direction_.dot(p - middle_);
  }

 private:
  Eigen::Vector2f origin_ = Eigen::Vector2f::Zero();
  Eigen::Vector2d sum_ = Eigen::Vector2d::Zero();
  double sum_xx_ = 0.0;
  double sum_xy_ = 0.0;
  double sum_yy_ = 0.0;
  int count_ = 0;
  Eigen::Vector2f direction_ = Eigen::Vector2f(1.0F, 0.0F);
  Eigen::Vector2f middle_ = Eigen::Vector2f::Zero();
  double normal_variance_ = 0.0;
};

}  // namespace point_line_odometry
