#pragma once

#include <unistd.h>

#include <utility>

namespace meltbench::link {

/// Owns one POSIX descriptor and closes it exactly once. Move-only; empty = -1. Not thread-safe.
class UniqueFd {
 public:
  explicit UniqueFd(int fd = kNone) noexcept : fd_{fd} {}
  UniqueFd(UniqueFd&& from) noexcept : fd_{from.release()} {}
  UniqueFd& operator=(UniqueFd&& from) noexcept {
    if (this != &from) {
      close();
      fd_ = from.release();
    }
    return *this;
  }
  UniqueFd(const UniqueFd&) = delete;
  UniqueFd& operator=(const UniqueFd&) = delete;
  ~UniqueFd() { close(); }

  [[nodiscard]] int get() const noexcept { return fd_; }
  [[nodiscard]] explicit operator bool() const noexcept { return fd_ != kNone; }
  [[nodiscard]] int release() noexcept { return std::exchange(fd_, kNone); }

 private:
  static constexpr int kNone = -1;
  void close() noexcept {
    if (fd_ != kNone) ::close(release());  // No retry on EINTR: Linux has freed the number already.
  }
  int fd_;
};

}  // namespace meltbench::link
