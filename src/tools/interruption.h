#pragma once

#include <exception>

namespace point_line_odometry {

/// Thrown when the user interrupts the program (Ctrl-C); destructors remove incomplete files.
class Interrupted : public std::exception {
 public:
  const char* what() const noexcept override { return "interrupted"; }
};

/// From now on the first SIGINT, SIGTERM or SIGHUP is only noted; the second one ends the program.
void noteInterruptions();

/// To be called between two steps of a long run.
void throwIfInterrupted();

/// Ends the program by the signal's default action, so that the caller sees the signal.
void endByInterruption();

}  // namespace point_line_odometry
