#include "protocols/link/pseudo_terminal.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <climits>
#include <cstring>
#include <string_view>

#include "protocols/link/can_link.hpp"

namespace meltbench::link {
namespace {

constexpr std::string_view kFolder = "/dev/pts/";

[[noreturn]] void fail() {
  throw LinkError{fmt::format("cannot make a pseudo-terminal: {}", std::strerror(errno)), "is /dev/pts mounted?"};
}

UniqueFd open_raw(const std::string& device) {
  UniqueFd fd{::open(device.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC)};
  if (!fd || !make_raw(fd.get())) fail();
  return fd;
}

/// Where a link leads; empty: it is none.
std::string read_link(const std::string& link) {
  std::array<char, PATH_MAX> target{};
  const ssize_t size = ::readlink(link.c_str(), target.data(), target.size());
  return size > 0 ? std::string{target.data(), static_cast<std::size_t>(size)} : std::string{};
}

/// A symbolic link, put in place in one step. The only thing that it replaces is the link of a bench that was killed.
bool put_link(const std::string& target, const std::string& link) {
  struct stat status {};
  if (::lstat(link.c_str(), &status) == 0 && !read_link(link).starts_with(kFolder)) {
    errno = EEXIST;
    return false;
  }
  const std::string fresh = link + ".new";
  ::unlink(fresh.c_str());
  return ::symlink(target.c_str(), fresh.c_str()) == 0 && ::rename(fresh.c_str(), link.c_str()) == 0;
}

}  // namespace

bool make_raw(int fd) noexcept {
  termios terminal{};
  if (::tcgetattr(fd, &terminal) != 0) return false;
  ::cfmakeraw(&terminal);
  terminal.c_cflag |= CLOCAL | CREAD;
  return ::tcsetattr(fd, TCSANOW, &terminal) == 0;
}

PseudoTerminal::PseudoTerminal(std::string name)
    : name_{std::move(name)}, near_end_{::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC)} {
  std::array<char, 64> device{};
  if (!near_end_ || ::grantpt(near_end_.get()) != 0 || ::unlockpt(near_end_.get()) != 0 ||
      ::ptsname_r(near_end_.get(), device.data(), device.size()) != 0) {
    fail();
  }
  device_ = device.data();
  open_raw(device_);
  if (!put_link(device_, name_)) {
    throw LinkError{fmt::format("cannot make \"{}\", the name of the pseudo-terminal: {}", name_, std::strerror(errno)),
                    "name a file that is not there, in a folder that you may write to, e.g. /tmp/line"};
  }
}

PseudoTerminal::~PseudoTerminal() {
  if (read_link(name_) == device_) ::unlink(name_.c_str());
}

bool PseudoTerminal::has_user() const {
  pollfd state{near_end_.get(), 0, 0};
  return ::poll(&state, 1, 0) == 0;  // Else it says POLLHUP, which need not be asked for.
}

void PseudoTerminal::hold_far_end() {
  far_end_ = open_raw(device_);
}

}  // namespace meltbench::link
