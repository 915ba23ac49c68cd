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
  kOutOfRange,       ///< no time, or so near to the end of ROS' time that arithmetic on it throws
  kUnconfirmedJump,  ///< far from those before, and those after it are not there either
};

/// Lets the messages of one topic pass in their order, except those whose stamps must not reach
/// what calculates with stamps (message_filters, the odometry, tf). Where stamps jump, messages are
/// held until the jump is confirmed: kConfirmations of them in a row have rising stamps there. They
/// pass then, so that a true jump costs none. Nothing is calculated with ros::Duration, which
/// throws when a difference is too long for it. Not thread-safe.
class StampFilter {
 public:
  using Deliver = std::function<void()>;

  /// A message that does not pass.
  struct Rejection {
    ros::Time stamp;
    StampFault fault = StampFault::kZero;

    /// For example "stamp 0.000000000 is no time".
    std::string text() const;
  };

  struct Decision {
    std::optional<double> jump_s;  ///< of the clock, confirmed now, before what passes
    std::vector<Deliver> passed;
    std::vector<Rejection> rejected;
  };

  StampFilter();

  /// Takes a message; it passes or is rejected now or by one of the next calls.
  /// \param now present time, 0 if it is not known: a first stamp in the future must be confirmed.
  /// \param deliver takes the message on its way.
  Decision add(const ros::Time& stamp, const ros::Time& now, Deliver deliver);

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
