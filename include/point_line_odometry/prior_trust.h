#pragma once

#include <tuple>

namespace point_line_odometry {

/// Whether a source of motion priors is used: after three in a row, or a quarter of the latest,
/// that disagree with the images it is suspended, until a dozen in a row have agreed.
class PriorTrust {
 public:
  bool isTrusted() const { return trusted_; }

  /// \param agreed whether a prior agreed with the motion by the images.
  void update(bool agreed) {
    constexpr double kMemory = 10.0;
    constexpr double kMaxRejectedShare = 0.25;
    constexpr int kAgreements = 12;
    if (trusted_) {
      rejected_share_ += ((agreed ? 0.0 : 1.0) - rejected_share_) / kMemory;
      trusted_ = rejected_share_ <= kMaxRejectedShare;
      agreed_in_a_row_ = 0;
      return;
    }
    agreed_in_a_row_ = agreed ? agreed_in_a_row_ + 1 : 0;
    if (agreed_in_a_row_ >= kAgreements) *this = PriorTrust();
  }

  /// All members, for StereoOdometry::saveState().
  auto state() {
    auto& [trusted, rejected_share, agreed_in_a_row] = *this;
    return std::tie(trusted, rejected_share, agreed_in_a_row);
  }

 private:
  bool trusted_ = true;
  double rejected_share_ = 0.0;  // of about the ten latest that were compared
  int agreed_in_a_row_ = 0;      // while it is suspended
};

}  // namespace point_line_odometry
