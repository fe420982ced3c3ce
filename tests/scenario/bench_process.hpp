#pragma once
/// Starts the bench as a user does, and looks at what it says and leaves behind.

#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <catch2/catch.hpp>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/tools/temporary_folder.hpp"

namespace meltbench::test {

inline std::filesystem::path scenario_file(const std::string& name) {
  return std::filesystem::path{MELTBENCH_SOURCE_DIR} / "fixtures/scenarios" / (name + ".toml");
}

/// A program of ours that runs; what it prints goes to a file.
class BenchProcess {
 public:
  BenchProcess(const std::vector<std::string>& arguments, const std::filesystem::path& log,
               const std::string& program = "meltbench")
      : log_{log} {
    std::vector<std::string> words{std::string{MELTBENCH_BIN_DIR} + "/" + program};
    words.insert(words.end(), arguments.begin(), arguments.end());
    std::vector<char*> raw;
    for (std::string& word : words) raw.push_back(word.data());
    raw.push_back(nullptr);
    pid_ = ::fork();
    REQUIRE(pid_ >= 0);
    if (pid_ == 0) {
      const int file = ::open(log.c_str(), O_CREAT | O_WRONLY | O_TRUNC, 0600);
      ::dup2(file, STDOUT_FILENO);
      ::dup2(file, STDERR_FILENO);
      ::execv(raw.front(), raw.data());
      ::_exit(127);
    }
  }
  ~BenchProcess() {
    if (pid_ > 0) {
      ::kill(pid_, SIGKILL);
      ::waitpid(pid_, nullptr, 0);
    }
  }
  BenchProcess(const BenchProcess&) = delete;
  BenchProcess& operator=(const BenchProcess&) = delete;

  [[nodiscard]] pid_t pid() const { return pid_; }
  [[nodiscard]] std::string output() const { return read_file(log_); }

  /// Waits for its end. @returns its exit status, 128 + signal if it was killed.
  int wait() {
    int status = 0;
    ::waitpid(pid_, &status, 0);
    pid_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }

  /// The child process of this name, once there is one.
  [[nodiscard]] pid_t find_child(const std::string& name) const {
    while (true) {
      std::istringstream children{
          read_file("/proc/" + std::to_string(pid_) + "/task/" + std::to_string(pid_) + "/children")};
      for (pid_t child = 0; children >> child;) {
        if (read_file("/proc/" + std::to_string(child) + "/comm").starts_with(name.substr(0, 15))) return child;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds{1});
    }
  }

 private:
  std::filesystem::path log_;
  pid_t pid_ = -1;
};

struct BenchResult {
  int status = 0;
  std::string output;
};

inline BenchResult run_bench(const std::vector<std::string>& arguments, const std::string& program = "meltbench") {
  const TemporaryFolder folder;
  BenchProcess process{arguments, folder.path() / "output", program};
  const int status = process.wait();
  return {status, process.output()};
}

}  // namespace meltbench::test
