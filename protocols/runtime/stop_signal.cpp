#include "protocols/runtime/stop_signal.hpp"

#include <csignal>

namespace meltbench::runtime {
namespace {

volatile std::sig_atomic_t stop_flag = 0;

void on_signal(int) {
  stop_flag = 1;
}

}  // namespace

void catch_stop_signals() {
  struct sigaction action {};
  action.sa_handler = on_signal;
  action.sa_flags = static_cast<int>(SA_RESETHAND);  // No SA_RESTART: a blocked call returns and the loop looks.
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

bool stop_requested() noexcept {
  return stop_flag != 0;
}

}  // namespace meltbench::runtime
