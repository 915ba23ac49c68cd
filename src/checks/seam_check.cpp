#include "checks/seam_check.h"

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <vector>

namespace point_line_odometry {
namespace {

/// For each column the share of the rows in which the brightness jumps there, and neither one
/// column before nor after it.
std::vector<double> jumpShares(const cv::Mat& image) {
  constexpr int kLeastJump = 8;  // [grey levels], more than noise
  constexpr int kTimesBeside = 2;
  std::vector<int> counts(static_cast<std::size_t>(image.cols), 0);
  for (int y = 0; y < image.rows; ++y) {
    const std::uint8_t* row = image.ptr<std::uint8_t>(y);
    const auto jump = [row](int x) { return std::abs(row[x] - row[x - 1]); };
    for (int x = 2; x + 1 < image.cols; ++x) {
      const int beside = std::max(jump(x - 1), jump(x + 1));
      if (jump(x) > kLeastJump + kTimesBeside * beside) ++counts[static_cast<std::size_t>(x)];
    }
  }
  std::vector<double> shares;
  shares.reserve(counts.size());
  for (const int count : counts) shares.push_back(static_cast<double>(count) / image.rows);
  return shares;
}

/// True if a column shows something: it is not padding.
bool hasContrast(const cv::Mat& image, int x) {
  constexpr double kLeastContrast = 1.5;  // [grey levels], of noise alone
  cv::Scalar mean, deviation;
  cv::meanStdDev(image.col(x), mean, deviation);
  return deviation[0] >= kLeastContrast;
}

}  // namespace

std::optional<int> commonSeam(const cv::Mat& left, const cv::Mat& right) {
  constexpr double kLeastShare = 0.35;
  if (left.empty() || left.type() != CV_8UC1 || right.type() != CV_8UC1) return std::nullopt;
  if (left.size() != right.size()) return std::nullopt;
  std::vector<double> shares = jumpShares(left);
  const std::vector<double> others = jumpShares(right);
  for (std::size_t x = 0; x < shares.size(); ++x) shares[x] = std::min(shares[x], others[x]);
  const auto best = std::max_element(shares.begin(), shares.end());
  if (*best < kLeastShare) return std::nullopt;
  const auto column = static_cast<int>(best - shares.begin());
  for (const cv::Mat* image : {&left, &right}) {
    if (!hasContrast(*image, column - 1) || !hasContrast(*image, column)) return std::nullopt;
  }
  return column;
}

}  // namespace point_line_odometry
