#pragma once

#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <unistd.h>

#include <array>
#include <catch2/catch.hpp>
#include <string>

#include "protocols/link/serial_link.hpp"

namespace meltbench::test {

/// The far end of a pseudo-terminal that a test holds: a device that can be unplugged.
class Device {
 public:
  Device() : fd_{::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC)} {
    REQUIRE((fd_ && ::grantpt(fd_.get()) == 0 && ::unlockpt(fd_.get()) == 0));
  }
  [[nodiscard]] std::string name() const { return ::ptsname(fd_.get()); }
  [[nodiscard]] int fd() const { return fd_.get(); }
  void unplug() { fd_ = link::UniqueFd{}; }
  void write(const std::string& text) const {
    REQUIRE(::write(fd_.get(), text.data(), text.size()) == static_cast<ssize_t>(text.size()));
  }
  /// As many bytes as are expected; fewer if they do not come within seconds.
  [[nodiscard]] std::string read(std::size_t size) const {
    std::string text;
    pollfd watched{fd_.get(), POLLIN, 0};
    while (text.size() < size && ::poll(&watched, 1, 5000) > 0) {
      std::array<char, 256> buffer{};
      const ssize_t got = ::read(fd_.get(), buffer.data(), std::min(buffer.size(), size - text.size()));
      if (got <= 0) break;
      text.append(buffer.data(), static_cast<std::size_t>(got));
    }
    return text;
  }

 private:
  link::UniqueFd fd_;
};

inline std::span<const std::uint8_t> bytes_of(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

/// Waits until there is something to read, or the device has gone.
inline void wait_for(int fd) {
  pollfd watched{fd, POLLIN, 0};
  REQUIRE(::poll(&watched, 1, 5000) > 0);
}

inline std::string read_text(link::SerialLink& port, std::size_t size) {
  std::string text;
  while (text.size() < size) {
    wait_for(port.fd());
    const auto received = port.receive();
    if (received) text.append(received->bytes.begin(), received->bytes.end());
  }
  return text;
}

}  // namespace meltbench::test
