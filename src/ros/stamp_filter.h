#pragma once

#include <ros/time.h>

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace point_line_odometry {

/// What is wrong with the stamp of a message.
enum class StampFault {
  kZero,
  kOutOfRange,       ///< or so near to the end of ros::Time that arithmetic on it throws
  kUnconfirmedJump,  ///< far from the stamps before it, and not confirmed by those after it
};

/// Passes the messages of one topic in order, except those whose stamps must not reach code that
/// calculates with stamps (message_filters, the odometry, tf). After a jump, messages are queued
/// until the jump is confirmed by kConfirmations rising stamps in a row, and then pass, so that a
/// true jump loses no message. ros::Duration is not used, as it throws on long differences. Not
/// thread-safe.
class StampFilter {
 public:
  using Deliver = std::function<void()>;

  /// A message that does not pass.
  struct Rejection {
    ros::Time stamp;
    StampFault fault = StampFault::kZero;

    /// For example "stamp 0.000000000 is no valid time".
    std::string text() const;
  };

  struct Decision {
    std::optional<double> jump_s;  ///< of the clock, confirmed now, before what passes
    std::vector<Deliver> passed;
    std::vector<Rejection> rejected;
  };

  StampFilter();

  /// Adds a message; it passes or is rejected now or by one of the next calls.
  /// \param now current time, 0 if unknown: a first stamp in the future must be confirmed.
  /// \param deliver called by the caller if the message passes.
  Decision add(const ros::Time& stamp, const ros::Time& now, Deliver deliver);

  /// At the end of all messages: those that are queued pass if they come within an hour after the
  /// others, as after a pause.
  Decision flush();

 private:
  struct Held {
    ros::Time stamp;
    std::int64_t stamp_ns;
    Deliver deliver;
  };

  bool continues(std::int64_t stamp_ns, const ros::Time& now) const;
  bool risesFromHeld(std::int64_t stamp_ns) const;
  void confirm(Decision* decision);
  void rejectHeld(Decision* decision);

  std::optional<std::int64_t> newest_ns_;  // of those that passed
  std::int64_t max_step_ns_;               // a longer one forwards is a jump
  std::vector<Held> held_;                 // fewer than kConfirmations
};

}  // namespace point_line_odometry
