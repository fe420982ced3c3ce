#pragma once

#include <sys/types.h>

#include <optional>
#include <string>
#include <vector>

namespace meltbench::cli {

/// A program that the bench has started. Killed, if it still runs, when this object goes; it also dies with the bench.
/// It is in a process group of its own: Ctrl-C reaches the bench alone, which then ends its children in order.
class ChildProcess {
 public:
  /// @param command  program and arguments.
  /// @param cpu  the one processor that it may use; nothing: any.
  /// @throws std::system_error if it cannot be started.
  ChildProcess(std::string name, const std::vector<std::string>& command, std::optional<int> cpu);
  ~ChildProcess();
  ChildProcess(ChildProcess&& from) noexcept;
  ChildProcess& operator=(ChildProcess&&) = delete;

  [[nodiscard]] const std::string& name() const { return name_; }
  /// How it ended, in words ("ended with status 2", "was killed by signal 9"); nothing while it runs.
  [[nodiscard]] std::optional<std::string> find_end();
  /// Whether it has ended because what it was given is no good, which it has told the user.
  [[nodiscard]] bool has_refused();
  /// Waits for it to end by itself for as long as a program takes to notice that it shall; then kills it.
  void finish();

 private:
  /// @returns true if it has ended.
  bool poll_end();

  std::string name_;
  pid_t pid_ = -1;
  std::optional<int> wait_status_;
};

}  // namespace meltbench::cli
