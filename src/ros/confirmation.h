#pragma once

#include <algorithm>
#include <optional>

namespace point_line_odometry {

/// What should stay as it is (clock, calibration, frame_id) changes when so many messages in a row
/// say so: a few bad ones change nothing.
constexpr int kConfirmations = 3;

/// Counts how often in a row a value came that is not the one in force.
template <typename Value>
class Confirmation {
 public:
  /// Adds a value other than the one in force. True if it is the same for the kConfirmations-th
  /// time.
  bool add(const Value& value) {
    if (!candidate_ || !(*candidate_ == value)) count_ = 0;
    candidate_ = value;
    count_ = std::min(count_ + 1, kConfirmations);
    return count_ == kConfirmations;
  }

  /// True if add() of this value would be.
  bool awaits(const Value& value) const {
    return candidate_ && *candidate_ == value && count_ + 1 >= kConfirmations;
  }

  /// The value in force has come again.
  void clear() { candidate_.reset(); }

 private:
  std::optional<Value> candidate_;
  int count_ = 0;
};

}  // namespace point_line_odometry
