#include "tools/interruption.h"

#include <csignal>
#include <initializer_list>

namespace point_line_odometry {
namespace {

/// The signal that was received, 0 if none.
volatile std::sig_atomic_t interrupting_signal = 0;

}  // namespace

void noteInterruptions() {
  struct sigaction action {};
  action.sa_handler = [](int signal) { interrupting_signal = signal; };
  action.sa_flags = static_cast<int>(SA_RESETHAND | SA_RESTART);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    struct sigaction before {};
    sigaction(signal, nullptr, &before);
    if (before.sa_handler != SIG_IGN) sigaction(signal, &action, nullptr);
  }
}

void throwIfInterrupted() {
  if (interrupting_signal != 0) throw Interrupted();
}

void endByInterruption() {
  const int signal = interrupting_signal;
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

}  // namespace point_line_odometry
