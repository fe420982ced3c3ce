#include "bench/tap/pty.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>

#include "protocols/link/can_link.hpp"

namespace meltbench::tap {
namespace {

[[noreturn]] void fail(const std::string& path, std::string_view what, std::string hint) {
  throw link::LinkError{fmt::format("--slcan-pty {}: {}: {}", path, what, std::strerror(errno)), std::move(hint)};
}

/// What a program that opens the other end finds: bytes as they are, no echo.
void make_raw(const std::string& device) {
  const link::UniqueFd slave{::open(device.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC)};
  termios settings{};
  ::tcgetattr(slave.get(), &settings);
  ::cfmakeraw(&settings);
  ::tcsetattr(slave.get(), TCSANOW, &settings);
}

}  // namespace

Pty::Pty(std::string path)
    : path_{std::move(path)}, master_{::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC)} {
  if (!master_ || ::grantpt(master_.get()) != 0 || ::unlockpt(master_.get()) != 0) {
    fail(path_, "cannot make a pseudo-terminal", "is /dev/pts mounted?");
  }
  const std::string device = ::ptsname(master_.get());
  make_raw(device);
  std::error_code error;
  const bool is_old = std::filesystem::read_symlink(path_, error).string().starts_with("/dev/pts/");
  if (is_old) ::unlink(path_.c_str());  // Left by a bench that was killed.
  if (::symlink(device.c_str(), path_.c_str()) != 0) fail(path_, "cannot make the link", "choose a path that is free");
}

Pty::~Pty() {
  ::unlink(path_.c_str());
}

bool Pty::has_user() const {
  pollfd state{master_.get(), 0, 0};
  return ::poll(&state, 1, 0) == 0;  // Else it says POLLHUP, which need not be asked for.
}

link::UniqueFd Pty::duplicate() const {
  return link::UniqueFd{::fcntl(master_.get(), F_DUPFD_CLOEXEC, 0)};
}

}  // namespace meltbench::tap
