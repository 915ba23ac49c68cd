#include "tools/prior_file.h"

#include <Eigen/Geometry>
#include <cmath>
#include <fstream>
#include <locale>
#include <sstream>
#include <vector>

#include "common/input_error.h"

namespace point_line_odometry {
namespace {

constexpr std::size_t kNumbers = 15;

std::int64_t toStamp(long double stamp_s) {
  constexpr long double kMaxStamp_s = 4e9L;  // limit of ros::Time
  if (!(stamp_s >= 0.0L) || stamp_s > kMaxStamp_s) throw InputError("no stamp in seconds");
  return std::llround(stamp_s * 1e9L);
}

MotionPrior parsePrior(const std::string& row) {
  std::istringstream in(row);
  in.imbue(std::locale::classic());
  std::vector<long double> n;
  for (long double number = 0.0L; in >> number;) n.push_back(number);
  if (!in.eof() || n.size() != kNumbers) throw InputError("not 15 numbers");
  const auto at = [&n](std::size_t i) { return static_cast<double>(n[i]); };
  MotionPrior prior;
  prior.from_ns = toStamp(n[0]);
  prior.to_ns = toStamp(n[1]);
  prior.T_prev_curr.translation() << at(2), at(3), at(4);
  const Eigen::Quaterniond q(at(8), at(5), at(6), at(7));
  if (!(std::abs(q.norm() - 1.0) < 0.01)) throw InputError("no unit quaternion");
  prior.T_prev_curr.linear() = q.normalized().toRotationMatrix();
  for (int i = 0; i < 6; ++i) {
    const double sigma = at(9 + static_cast<std::size_t>(i));
    if (!(sigma >= 0.0) || !std::isfinite(sigma))
      throw InputError("a deviation that is negative or not finite");
    prior.information(i, i) = sigma > 0.0 ? 1.0 / (sigma * sigma) : 0.0;
  }
  if (!prior.T_prev_curr.matrix().allFinite() || !prior.information.allFinite())
    throw InputError("a number that is too large, or a deviation that is too small");
  return prior;
}

}  // namespace

PriorsByStamp readPriors(const std::string& file) {
  std::ifstream in(file);
  if (!in) throw InputError("prior file '" + file + "' cannot be read: check the path");
  PriorsByStamp priors;
  for (std::string row; std::getline(in, row);) {
    if (row.empty() || row.front() == '#') continue;
    try {
      const MotionPrior prior = parsePrior(row);
      priors[prior.to_ns] = prior;
    } catch (const InputError& error) {
      throw InputError("prior file '" + file + "': " + error.what() + " in '" + row + "'");
    }
  }
  return priors;
}

}  // namespace point_line_odometry
