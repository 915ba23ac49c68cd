#include "dataset/trajectory.h"

#include <array>
#include <cmath>
#include <fstream>
#include <iomanip>
#include <locale>
#include <ostream>
#include <sstream>

#include "common/classic_stream.h"

namespace point_line_odometry {
namespace {

/// The row's 8 numbers. False if it has anything else.
bool parseRow(const std::string& row, std::array<long double, 8>* numbers) {
  std::istringstream in(row);
  in.imbue(std::locale::classic());
  for (long double& number : *numbers) {
    if (!(in >> number)) return false;
  }
  return (in >> std::ws).eof();
}

/// The pose of a row. Throws InputError with the end of a sentence that starts with the row.
StampedPose parsePose(const std::string& row) {
  constexpr long double kMaxStamp_s = 4e9L;  // limit of ros::Time
  constexpr double kUnitTolerance = 0.01;
  std::array<long double, 8> n{};
  if (!parseRow(row, &n)) throw InputError("is not the 8 numbers 'stamp tx ty tz qx qy qz qw'");
  if (!(n[0] >= 0.0L) || n[0] > kMaxStamp_s) throw InputError("has no stamp in seconds");
  const auto number = [&n](std::size_t i) { return static_cast<double>(n[i]); };
  const Eigen::Quaterniond q(number(7), number(4), number(5), number(6));
  if (!(std::abs(q.norm() - 1.0) < kUnitTolerance)) throw InputError("has no unit quaternion");
  StampedPose pose;
  // A long double has enough digits for the nanoseconds since 1970.
  pose.stamp_ns = std::llround(n[0] * 1e9L);
  pose.T_world_camera.linear() = q.normalized().toRotationMatrix();
  pose.T_world_camera.translation() << number(1), number(2), number(3);
  if (!pose.T_world_camera.matrix().allFinite()) throw InputError("has no finite position");
  return pose;
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
    writeStamp(text, pose.stamp_ns);
    const Eigen::Vector3d& t = pose.T_world_camera.translation();
    for (const double value : {t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w()}) {
      text << ' ' << withoutNegativeZero(value);
    }
    text << '\n';
  }
  out << text.str();
}

std::vector<StampedPose> readTum(const std::string& file) {
  std::ifstream in(file);
  if (!in) throw InputError("trajectory '" + file + "' cannot be read: check the path");
  std::vector<StampedPose> poses;
  std::size_t number = 0;
  for (std::string row; std::getline(in, row);) {
    ++number;
    const std::size_t begin = row.find_first_not_of(" \t\r");
    if (begin == std::string::npos || row[begin] == '#') continue;
    try {
      poses.push_back(parsePose(row));
      const bool later = poses.size() < 2 || (poses.end() - 2)->stamp_ns < poses.back().stamp_ns;
      if (!later) throw InputError("is not later than the row before");
    } catch (const InputError& error) {
      throw InputError("trajectory '" + file + "', line " + std::to_string(number) + " " +
                       error.what() + ": give a trajectory in TUM's format");
    }
  }
  if (poses.empty()) {
    throw InputError("trajectory '" + file + "' has no pose: give rows of 8 numbers, TUM's format");
  }
  return poses;
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
