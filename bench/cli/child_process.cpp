#include "bench/cli/child_process.hpp"

#include <fmt/format.h>
#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <system_error>
#include <thread>
#include <utility>

#include "bench/cli/exit_status.hpp"

namespace meltbench::cli {
namespace {

constexpr std::chrono::milliseconds kGrace{300};  // A run must end within 2 s of a loss; the watchdog takes 1.5 s.

/// In the child, between fork and exec: only calls that are safe there.
[[noreturn]] void become(const std::vector<char*>& arguments, const std::optional<int>& cpu, pid_t parent) {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (::getppid() != parent) ::_exit(127);  // The bench died before the line above.
  ::setpgid(0, 0);
  if (cpu) {
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET(static_cast<std::size_t>(*cpu), &set);
    ::sched_setaffinity(0, sizeof(set), &set);
  }
  ::execv(arguments.front(), arguments.data());
  ::_exit(127);
}

}  // namespace

ChildProcess::ChildProcess(std::string name, const std::vector<std::string>& command, std::optional<int> cpu)
    : name_{std::move(name)} {
  if (::access(command.front().c_str(), X_OK) != 0) {
    throw std::system_error{errno, std::generic_category(), "cannot start " + command.front()};
  }
  std::vector<char*> arguments;
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  const pid_t parent = ::getpid();
  pid_ = ::fork();
  if (pid_ == 0) become(arguments, cpu, parent);
  if (pid_ < 0) throw std::system_error{errno, std::generic_category(), "cannot start " + command.front()};
}

ChildProcess::ChildProcess(ChildProcess&& from) noexcept
    : name_{std::move(from.name_)}, pid_{std::exchange(from.pid_, -1)}, wait_status_{from.wait_status_} {}

ChildProcess::~ChildProcess() {
  if (pid_ < 0 || poll_end()) return;
  ::kill(pid_, SIGKILL);
  ::waitpid(pid_, nullptr, 0);
}

bool ChildProcess::poll_end() {
  if (wait_status_) return true;
  int status = 0;
  if (::waitpid(pid_, &status, WNOHANG) != pid_) return false;
  wait_status_ = status;
  return true;
}

std::optional<std::string> ChildProcess::find_end() {
  if (!poll_end()) return std::nullopt;
  if (WIFSIGNALED(*wait_status_)) return fmt::format("was killed by signal {}", WTERMSIG(*wait_status_));
  return fmt::format("ended with status {}", WEXITSTATUS(*wait_status_));
}

bool ChildProcess::has_refused() {
  return poll_end() && WIFEXITED(*wait_status_) && WEXITSTATUS(*wait_status_) == static_cast<int>(ExitStatus::kUsage);
}

void ChildProcess::finish() {
  const auto until = std::chrono::steady_clock::now() + kGrace;
  while (!poll_end() && std::chrono::steady_clock::now() < until) {
    std::this_thread::sleep_for(std::chrono::milliseconds{1});
  }
  if (poll_end()) return;
  ::kill(pid_, SIGKILL);
  int status = 0;
  if (::waitpid(pid_, &status, 0) == pid_) wait_status_ = status;
}

}  // namespace meltbench::cli
