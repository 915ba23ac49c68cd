#pragma once

#include <cmath>
#include <tuple>

namespace point_line_odometry {

/// Whether a source of motion priors is used: after some in a row, or as large a share of the
/// latest, that disagree with the images it is suspended, until a dozen in a row have agreed.
class PriorTrust {
 public:
  /// \param rejections in a row that suspend the source.
  explicit PriorTrust(int rejections = 3)
      : max_rejected_share_(1.0 - std::pow(1.0 - kUpdate, rejections - 0.5)) {}

  /// False while it is suspended.
  bool isTrusted() const { return trusted_; }

  /// \param agreed whether a prior agreed with the motion by the images.
  void update(bool agreed) {
    constexpr int kAgreements = 12;
    if (trusted_) {
      rejected_share_ += kUpdate * ((agreed ? 0.0 : 1.0) - rejected_share_);
      trusted_ = rejected_share_ <= max_rejected_share_;
      agreed_in_a_row_ = 0;
      return;
    }
    agreed_in_a_row_ = agreed ? agreed_in_a_row_ + 1 : 0;
    if (agreed_in_a_row_ < kAgreements) return;
    trusted_ = true;
    rejected_share_ = 0.0;
  }

  /// All members, for StereoOdometry::saveState().
  auto state() {
    auto& [max_rejected_share, trusted, rejected_share, agreed_in_a_row] = *this;
    return std::tie(max_rejected_share, trusted, rejected_share, agreed_in_a_row);
  }

 private:
  static constexpr double kUpdate = 0.1;  // the share is that of about the ten latest

  double max_rejected_share_;
  bool trusted_ = true;
  double rejected_share_ = 0.0;
  int agreed_in_a_row_ = 0;  // while it is suspended
};

}  // namespace point_line_odometry
