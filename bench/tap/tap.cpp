#include "bench/tap/tap.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cstring>

#include "bench/tap/client.hpp"
#include "bench/tap/kernel_mirror.hpp"
#include "bench/tap/slcan_adapter.hpp"
#include "bench/tap/socketcand.hpp"
#include "protocols/link/can_link.hpp"
#include "protocols/runtime/real_time_clock.hpp"

namespace meltbench::tap {
namespace {

constexpr int kMaxPending = 16;
constexpr std::size_t kMaxOnTheirWay = 4096;
constexpr int kSendBuffer = 256 << 10;
constexpr Nanos kLongestDrain = 10s;  // For clients that read, but too slowly.
constexpr std::string_view kUnixPrefix = "unix:";

[[noreturn]] void fail(std::string_view address, std::string_view why, std::string hint) {
  throw link::LinkError{fmt::format("cannot listen on --tap {}: {}", address, why), std::move(hint)};
}

link::UniqueFd listen_on(int family, const sockaddr* address, socklen_t size, std::string_view text) {
  link::UniqueFd fd{::socket(family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0)};
  const int yes = 1;
  ::setsockopt(fd.get(), SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  if (!fd || ::bind(fd.get(), address, size) != 0 || ::listen(fd.get(), kMaxPending) != 0) {
    fail(text, std::strerror(errno), "choose another port, or 0 for one that is free");
  }
  return fd;
}

link::UniqueFd listen_on_port(std::string_view text, std::string& place) {
  std::uint16_t port = 0;
  const char* const end = text.data() + text.size();
  const auto parsed = std::from_chars(text.data(), end, port);
  if (parsed.ptr != end || parsed.ec != std::errc{}) {
    fail(text, "neither a port nor unix:/path", "socketcand's own port is 29536");
  }
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(port);
  socklen_t size = sizeof address;
  auto* const plain = reinterpret_cast<sockaddr*>(&address);
  link::UniqueFd fd = listen_on(AF_INET, plain, size, text);
  ::getsockname(fd.get(), plain, &size);
  place = fmt::format("socketcand on 127.0.0.1:{}", ntohs(address.sin_port));
  return fd;
}

link::UniqueFd listen_on_path(const std::string& path, std::string& place) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.empty() || path.size() >= sizeof address.sun_path) {
    fail("unix:" + path, "no path that a socket can have", "at most 107 characters, e.g. --tap unix:/run/user/0/tap");
  }
  path.copy(address.sun_path, sizeof address.sun_path - 1);
  const auto* const plain = reinterpret_cast<const sockaddr*>(&address);
  // A socket that nobody listens on any more was left by a bench that was killed.
  const link::UniqueFd probe{::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0)};
  if (::connect(probe.get(), plain, sizeof address) != 0 && errno == ECONNREFUSED) ::unlink(path.c_str());
  link::UniqueFd fd = listen_on(AF_UNIX, plain, sizeof address, "unix:" + path);
  place = "socketcand on unix:" + path;
  return fd;
}

}  // namespace

Tap::Tap(const TapOptions& options) : read_only_{options.read_only} {
  if (options.socketcand.starts_with(kUnixPrefix)) {
    const std::string path = options.socketcand.substr(kUnixPrefix.size());
    listener_ = listen_on_path(path, places_.emplace_back());
    unix_path_ = path;
  } else if (!options.socketcand.empty()) {
    listener_ = listen_on_port(options.socketcand, places_.emplace_back());
  }
  if (!options.slcan_pty.empty()) {
    pty_.emplace(options.slcan_pty);
    places_.push_back("slcan on " + options.slcan_pty);
  }
  if (!options.kernel_bus.empty()) {
    admit(open_kernel_mirror(options.kernel_bus, options.read_only));
    places_.push_back("on " + options.kernel_bus);
  }
}

Tap::~Tap() {
  if (!unix_path_.empty()) ::unlink(unix_path_.c_str());
}

void Tap::exchange(std::size_t room, std::vector<can::CanFrame>& frames) {
  accept_clients();
  look_at_pty();
  for (Guest& guest : guests_) {
    const std::size_t before = frames.size();
    guest.visitor->read(room, frames);
    room -= frames.size() - before;
    for (std::size_t i = before; i < frames.size(); ++i) on_their_way_.push_back({guest.number, frames[i]});
  }
  while (on_their_way_.size() > kMaxOnTheirWay) on_their_way_.pop_front();
  // Who was served first is served last next time: one that talks without end does not silence the others.
  if (!frames.empty() && guests_.size() > 1) std::rotate(guests_.begin(), guests_.begin() + 1, guests_.end());
  remove_gone();
}

void Tap::show(const can::StampedFrame& frame, std::size_t sender) {
  const std::uint64_t own = sender == bus::kTapSender ? take_sender_of(frame.frame) : 0;
  for (Guest& guest : guests_) {
    if (guest.number != own) guest.visitor->show(frame);
  }
}

void Tap::watch(std::vector<pollfd>& watched) const {
  if (listener_) watched.push_back({listener_.get(), POLLIN, 0});
  for (const Guest& guest : guests_) watched.push_back({guest.visitor->fd(), POLLIN, 0});
}

void Tap::wait_for(std::size_t clients, const std::function<bool()>& give_up) {
  std::vector<can::CanFrame> none;
  const auto ready = [this] {
    return std::ranges::count_if(guests_, [](const Guest& guest) { return guest.visitor->is_looking_on(); });
  };
  while (static_cast<std::size_t>(ready()) < clients && !give_up()) {
    wait(50ms);
    exchange(0, none);  // What a client sends before the run begins waits for it.
  }
}

void Tap::drain(Nanos patience) {
  const auto waits = [](const Guest& guest) { return guest.visitor->has_backlog(); };
  const auto handed = [this] {
    std::uint64_t sum = 0;
    for (const Guest& guest : guests_) sum += guest.visitor->handed();
    return sum;
  };
  const Nanos start = runtime::read_monotonic();
  Nanos read_last = start;
  std::vector<can::CanFrame> none;
  for (std::uint64_t before = handed(); std::ranges::any_of(guests_, waits); before = handed()) {
    wait(5ms);
    exchange(0, none);
    const Nanos now = runtime::read_monotonic();
    if (handed() != before) read_last = now;
    if (now - read_last > patience || now - start > kLongestDrain) break;
  }
  for (const Guest& guest : guests_) note_losses(*guest.visitor);
  guests_.clear();
}

void Tap::accept_clients() {
  if (!listener_) return;
  while (true) {
    link::UniqueFd fd{::accept4(listener_.get(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC)};
    if (!fd) return;
    const int yes = 1;
    ::setsockopt(fd.get(), IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);  // Fails on a Unix socket, which never waits.
    ::setsockopt(fd.get(), SOL_SOCKET, SO_SNDBUF, &kSendBuffer, sizeof kSendBuffer);
    const std::string name = fmt::format("tap client {}", next_number_);
    admit(std::make_unique<Client>(std::move(fd), std::make_unique<Socketcand>(read_only_), name));
  }
}

void Tap::admit(std::unique_ptr<Visitor> visitor) {
  guests_.push_back({next_number_++, std::move(visitor), false});
}

/// A program that opens the pseudo-terminal is a new client of an adapter that was just plugged in.
void Tap::look_at_pty() {
  if (!pty_ || pty_in_use_ || !pty_->has_user()) return;
  pty_in_use_ = true;
  link::UniqueFd fd{::fcntl(pty_->fd(), F_DUPFD_CLOEXEC, 0)};
  admit(std::make_unique<Client>(std::move(fd), std::make_unique<SlcanAdapter>(read_only_), pty_->name()));
  guests_.back().at_pty = true;
}

void Tap::remove_gone() {
  for (const Guest& guest : guests_) {
    if (!guest.visitor->is_gone()) continue;
    note_losses(*guest.visitor);
    if (guest.at_pty) pty_in_use_ = false;
  }
  std::erase_if(guests_, [](const Guest& guest) { return guest.visitor->is_gone(); });
}

void Tap::note_losses(const Visitor& visitor) {
  if (std::string complaint = visitor.complaint(); !complaint.empty()) complaints_.push_back(std::move(complaint));
}

/// @returns the number of the guest that has sent this frame, 0 if it is none of theirs. A bus hands frames on in the
/// order of their identifiers, so the oldest equal one is meant.
std::uint64_t Tap::take_sender_of(const can::CanFrame& frame) {
  const auto found = std::ranges::find(on_their_way_, frame, &Sent::frame);
  if (found == on_their_way_.end()) return 0;
  const std::uint64_t number = found->guest;
  on_their_way_.erase(found);
  return number;
}

void Tap::wait(Nanos at_most) const {
  std::vector<pollfd> watched;
  watch(watched);
  const timespec timeout{at_most / 1s, (at_most % 1s).count()};
  ::ppoll(watched.data(), watched.size(), &timeout, nullptr);
}

}  // namespace meltbench::tap
