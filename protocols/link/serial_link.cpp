#include "protocols/link/serial_link.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <libserialport.h>
#include <linux/serial.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <termios.h>

#include <cerrno>
#include <climits>
#include <cstring>

#include "protocols/link/can_link.hpp"
#include "protocols/link/clock.hpp"

namespace meltbench::link {
namespace {

constexpr std::string_view kOwnPty = "pty:";
constexpr unsigned kFirstPtyMajor = 136;  // Unix98 pseudo-terminals: majors 136..143 (Linux, devices.txt).
constexpr unsigned kLastPtyMajor = 143;

bool is_pseudo_terminal(const std::string& device) noexcept {
  struct stat status {};
  if (::stat(device.c_str(), &status) != 0 || !S_ISCHR(status.st_mode)) return false;
  return major(status.st_rdev) >= kFirstPtyMajor && major(status.st_rdev) <= kLastPtyMajor;
}

std::string hint_for(int error) {
  if (error == EACCES) return "add yourself to the group that owns it (Debian: dialout), or see \"ls -l\"";
  if (error == EBUSY) return "another program has it open: see \"fuser\"";
  return "see \"ls -l /dev/serial/by-id\"; \"pty:/run/NAME\" makes a pseudo-terminal instead";
}

sp_parity to_sp(serial::Parity parity) noexcept {
  switch (parity) {
    case serial::Parity::kEven:
      return SP_PARITY_EVEN;
    case serial::Parity::kOdd:
      return SP_PARITY_ODD;
    case serial::Parity::kNone:
      break;
  }
  return SP_PARITY_NONE;
}

bool configure(sp_port* port, const serial::LineSettings& settings) noexcept {
  return sp_set_baudrate(port, static_cast<int>(settings.baud_rate)) == SP_OK && sp_set_bits(port, 8) == SP_OK &&
         sp_set_parity(port, to_sp(settings.parity)) == SP_OK && sp_set_stopbits(port, settings.stop_bits) == SP_OK &&
         sp_set_flowcontrol(port, SP_FLOWCONTROL_NONE) == SP_OK && sp_flush(port, SP_BUF_BOTH) == SP_OK;
}

/// Lets a real port tell of each byte when it comes, as far as it can and this user may. By itself a 16550 keeps the
/// last bytes of a frame for four character times and an FTDI adapter for 16 ms, longer than the silence that ends a
/// Modbus frame.
void hold_no_bytes(int fd, const std::string& device) noexcept {
  serial_struct port{};
  if (::ioctl(fd, TIOCGSERIAL, &port) == 0) {
    port.flags |= ASYNC_LOW_LATENCY;
    static_cast<void>(::ioctl(fd, TIOCSSERIAL, &port));
  }
  const std::string level_file = "/sys/class/tty/" + device.substr(device.rfind('/') + 1) + "/rx_trig_bytes";
  const UniqueFd level{::open(level_file.c_str(), O_WRONLY | O_CLOEXEC)};
  if (level) static_cast<void>(!::write(level.get(), "1", 1));
}

}  // namespace

void SerialPort::CloseRealPort::operator()(sp_port* port) const noexcept {
  sp_close(port);
  sp_free_port(port);
}

SerialPort::SerialPort(std::string name, const serial::LineSettings& settings)
    : name_{std::move(name)}, settings_{settings} {
  const Failure failure = open();
  if (!failure.what.empty()) throw LinkError{failure.what, failure.hint};
}

SerialPort::Failure SerialPort::open() noexcept {
  if (name_.starts_with(kOwnPty)) return make_pseudo_terminal();
  // libserialport knows devices, not the links to them that udev makes.
  std::array<char, PATH_MAX> resolved{};
  if (::realpath(name_.c_str(), resolved.data()) == nullptr) {
    return {fmt::format("cannot open serial port \"{}\": {}", name_, std::strerror(errno)), hint_for(errno)};
  }
  const std::string device = resolved.data();
  return is_pseudo_terminal(device) ? open_pseudo_terminal(device) : open_real_port(device);
}

SerialPort::Failure SerialPort::open_real_port(const std::string& device) noexcept {
  sp_port* port = nullptr;
  if (sp_get_port_by_name(device.c_str(), &port) != SP_OK) {
    return {fmt::format("cannot open serial port \"{}\": {} is no serial port", name_, device), hint_for(0)};
  }
  if (sp_open(port, SP_MODE_READ_WRITE) != SP_OK) {
    const int error = sp_last_error_code();
    sp_free_port(port);
    return {fmt::format("cannot open serial port \"{}\": {}", name_, std::strerror(error)), hint_for(error)};
  }
  real_port_.reset(port);
  if (!configure(port, settings_) || sp_get_port_handle(port, &fd_) != SP_OK) {
    const int error = sp_last_error_code();
    close();
    return {fmt::format("cannot set up serial port \"{}\": {}", name_, std::strerror(error)),
            "the port may not know this baud_rate or format"};
  }
  hold_no_bytes(fd_, device);
  return {};
}

SerialPort::Failure SerialPort::open_pseudo_terminal(const std::string& device) noexcept {
  foreign_terminal_ = UniqueFd{::open(device.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC)};
  if (!foreign_terminal_ || !make_raw(foreign_terminal_.get())) {
    const int error = errno;
    close();
    return {fmt::format("cannot open serial port \"{}\": {}", name_, std::strerror(error)), hint_for(error)};
  }
  ::tcflush(foreign_terminal_.get(), TCIOFLUSH);
  fd_ = foreign_terminal_.get();
  return {};
}

SerialPort::Failure SerialPort::make_pseudo_terminal() noexcept {
  try {
    own_terminal_.emplace(name_.substr(kOwnPty.size()));
    own_terminal_->hold_far_end();
  } catch (const LinkError& error) {
    return {error.what(), error.hint()};
  }
  fd_ = own_terminal_->fd();
  return {};
}

std::size_t SerialPort::write(std::span<const std::uint8_t> bytes) noexcept {
  if (fd_ < 0) return 0;
  const ssize_t written = ::write(fd_, bytes.data(), bytes.size());
  if (written >= 0) return static_cast<std::size_t>(written);
  if (errno != EAGAIN && errno != EINTR) close();
  return 0;
}

std::optional<ReceivedBytes> SerialPort::receive() noexcept {
  if (fd_ < 0) return std::nullopt;
  const ssize_t size = ::read(fd_, buffer_.data(), buffer_.size());
  if (size > 0) return ReceivedBytes{read_monotonic(), {buffer_.data(), static_cast<std::size_t>(size)}};
  // libserialport's ports say 0 when nothing waits, and every port says 0 when the device has gone.
  const bool gone = size == 0 ? has_hung_up() : errno != EAGAIN && errno != EINTR;
  if (gone) close();
  return std::nullopt;
}

bool SerialPort::has_hung_up() const noexcept {
  pollfd watched{fd_, POLLIN, 0};
  return ::poll(&watched, 1, 0) > 0 && (watched.revents & (POLLHUP | POLLERR | POLLNVAL)) != 0;
}

void SerialPort::close() noexcept {
  fd_ = -1;
  foreign_terminal_ = UniqueFd{};
  own_terminal_.reset();
  real_port_.reset();
}

}  // namespace meltbench::link
