#include "point_line_odometry/trajectory.h"

#include <iomanip>
#include <locale>
#include <ostream>
#include <sstream>

namespace point_line_odometry {
namespace {

constexpr std::int64_t kNanosecondsPerSecond = 1000000000;

/// A stream whose numbers look the same whatever the user's language is.
std::ostringstream classicStream() {
  std::ostringstream text;
  text.imbue(std::locale::classic());
  return text;
}

/// Turns -0 into 0, so that equal numbers have equal text.
double withoutNegativeZero(double value) { return value + 0.0; }

}  // namespace

void writeTum(std::ostream& out, const std::vector<StampedPose>& trajectory) {
  std::ostringstream text = classicStream();
  text << std::fixed << std::setprecision(9);
  for (const StampedPose& pose : trajectory) {
    Eigen::Quaterniond q(pose.T_world_camera.linear());
    q.normalize();
    if (q.w() < 0.0) q.coeffs() = -q.coeffs();
    text << pose.stamp_ns / kNanosecondsPerSecond << '.' << std::setw(9) << std::setfill('0')
         << pose.stamp_ns % kNanosecondsPerSecond;
    const Eigen::Vector3d& t = pose.T_world_camera.translation();
    for (const double value : {t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w()}) {
      text << ' ' << withoutNegativeZero(value);
    }
    text << '\n';
  }
  out << text.str();
}

void writeKitti(std::ostream& out, const std::vector<StampedPose>& trajectory) {
  std::ostringstream text = classicStream();
  text << std::scientific << std::setprecision(9);
  for (const StampedPose& pose : trajectory) {
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 4; ++column) {
        text << (row + column > 0 ? " " : "")
             << withoutNegativeZero(pose.T_world_camera(row, column));
      }
    }
    text << '\n';
  }
  out << text.str();
}

}  // namespace point_line_odometry
