#include "tools/prior_file.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <locale>
#include <sstream>
#include <vector>

#include "common/classic_stream.h"
#include "common/input_error.h"
#include "dataset/text_rows.h"

namespace point_line_odometry {
namespace {

constexpr std::size_t kNumbers = 15;

constexpr std::size_t kNamedRows = 5;  // in a warning

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

/// From a stamp to the nearest frame.
std::int64_t distanceToFrame_ns(std::int64_t stamp_ns, const std::vector<std::int64_t>& frames_ns) {
  std::int64_t nearest_ns = std::abs(frames_ns.front() - stamp_ns);
  for (const std::int64_t frame_ns : frames_ns)
    nearest_ns = std::min(nearest_ns, std::abs(frame_ns - stamp_ns));
  return nearest_ns;
}

}  // namespace

PriorsByStamp readPriors(const std::string& file) {
  if (!std::ifstream(file))
    throw InputError("prior file '" + file + "' cannot be read: check the path");
  PriorsByStamp priors;
  for (const std::string& row : readLines(file)) {
    try {
      const MotionPrior prior = parsePrior(row);
      if (!priors.emplace(prior.to_ns, prior).second)
        throw InputError("a second motion that ends at the same stamp");
    } catch (const InputError& error) {
      throw InputError("prior file '" + file + "': " + error.what() + " in '" + row + "'");
    }
  }
  return priors;
}

std::vector<std::string> unmatchedRows(const PriorFileUse& use, const std::string& file,
                                       const std::vector<std::int64_t>& frames_ns) {
  if (frames_ns.size() < 2) return {};
  if (use.rows == 0) throw InputError("prior file '" + file + "' has no row for these frames");
  if (use.unmatched.empty()) return {};
  std::ostringstream text = classicStream();
  text << use.unmatched.size() << " of " << use.rows << " rows of prior file '" << file
       << "' are of no two frames in succession and were not used:";
  const std::size_t named = std::min(use.unmatched.size(), kNamedRows);
  for (std::size_t i = 0; i < named; ++i) {
    text << (i > 0 ? ", " : " ");
    writeStamp(text, use.unmatched[i].from_ns);
    text << " to ";
    writeStamp(text, use.unmatched[i].to_ns);
  }
  if (named < use.unmatched.size()) text << " and " << use.unmatched.size() - named << " more";
  const StampPair& first = use.unmatched.front();
  text << "; frames nearest to the stamps of the first are "
       << distanceToFrame_ns(first.from_ns, frames_ns) << " and "
       << distanceToFrame_ns(first.to_ns, frames_ns)
       << " ns away: give the stamps of frames to the nanosecond, of every Nth frame with --every";
  if (use.unmatched.size() == use.rows) throw InputError(text.str());
  return {text.str()};
}

}  // namespace point_line_odometry
