#pragma once

#include <algorithm>
#include <optional>

namespace point_line_odometry {

/// Number of messages in a row that must have the same new value before a value that should not
/// change (clock, calibration, frame_id) is replaced: a few bad messages change nothing.
constexpr int kConfirmations = 3;

/// Counts how many times in a row the same value other than the current one was received.
template <typename Value>
class Confirmation {
 public:
  /// Adds a value other than the current one. True if it is the kConfirmations-th in a row.
  bool add(const Value& value) {
    if (!candidate_ || !(*candidate_ == value)) count_ = 0;
    candidate_ = value;
    count_ = std::min(count_ + 1, kConfirmations);
    return count_ == kConfirmations;
  }

  /// True if add() of this value would return true.
  bool awaits(const Value& value) const {
    return candidate_ && *candidate_ == value && count_ + 1 >= kConfirmations;
  }

  /// To be called when the current value was received again.
  void clear() { candidate_.reset(); }

 private:
  std::optional<Value> candidate_;
  int count_ = 0;
};

}  // namespace point_line_odometry
