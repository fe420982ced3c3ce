#pragma once

#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <string_view>

namespace meltbench::link {

/// Writes all of it to a blocking descriptor, in as many pieces as that takes. @returns false, with errno: not all.
[[nodiscard]] inline bool write_all(int fd, std::string_view bytes) noexcept {
  while (!bytes.empty()) {
    const ssize_t count = ::write(fd, bytes.data(), bytes.size());
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return false;
    bytes.remove_prefix(static_cast<std::size_t>(count));
  }
  return true;
}

/// Appends to a file of `size` bytes all of it or nothing: what a full disk has taken of it is cut off again.
/// @returns false, with errno: nothing.
[[nodiscard]] inline bool append_whole(int fd, std::uint64_t size, std::string_view bytes) noexcept {
  if (write_all(fd, bytes)) return true;
  const int reason = errno;
  static_cast<void>(!::ftruncate(fd, static_cast<off_t>(size)));  // No more can be done; the complaint is the write's.
  errno = reason;
  return false;
}

}  // namespace meltbench::link
