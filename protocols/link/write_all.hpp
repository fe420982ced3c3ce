#pragma once

#include <unistd.h>

#include <cerrno>
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

}  // namespace meltbench::link
