#pragma once

#include <csignal>
#include <exception>
#include <initializer_list>

namespace point_line_odometry {

/// Thrown when the user has asked the program to end (Ctrl-C); on its way out whatever is not whole
/// takes itself away.
class Interrupted : public std::exception {
 public:
  const char* what() const noexcept override { return "interrupted"; }
};

/// The signal that has asked this program to end, 0 so far.
inline volatile std::sig_atomic_t interrupting_signal = 0;

/// From now on the first SIGINT, SIGTERM or SIGHUP is only noted; the second one ends the program.
inline void noteInterruptions() {
  struct sigaction action {};
  action.sa_handler = [](int signal) { interrupting_signal = signal; };
  action.sa_flags = static_cast<int>(SA_RESETHAND | SA_RESTART);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    struct sigaction before {};
    sigaction(signal, nullptr, &before);
    if (before.sa_handler != SIG_IGN) sigaction(signal, &action, nullptr);
  }
}

/// To be called between two steps of a long run.
inline void throwIfInterrupted() {
  if (interrupting_signal != 0) throw Interrupted();
}

/// Ends the program as the signal would have done, so that the caller sees why.
inline void endByInterruption() {
  const int signal = interrupting_signal;
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

}  // namespace point_line_odometry
