#include "bench/tap/client.hpp"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>

#include "protocols/runtime/real_time_clock.hpp"

namespace meltbench::tap {
namespace {

/// How long the first frames stay behind the answer that lets them come, unless the client says something before: it
/// must have read that answer alone.
constexpr Nanos kHold = 200ms;
constexpr std::size_t kMaxUnread = 4096;  ///< Said and not understood: more stays in the client's own queue.
/// Handed over in one piece, which ends at the end of a message: python-can 4.1.0 may lose a message that comes in two.
constexpr std::size_t kPiece = 16U << 10U;
constexpr int kMaxInFlight = 128 << 10;  ///< The kernel's queue takes a piece on top of this, whole.

/// As write(2), but a socket whose other end has gone raises no signal.
ssize_t write_some(int fd, const char* bytes, std::size_t size) {
  const ssize_t sent = ::send(fd, bytes, size, MSG_NOSIGNAL | MSG_DONTWAIT);
  return sent < 0 && errno == ENOTSOCK ? ::write(fd, bytes, size) : sent;
}

}  // namespace

Client::Client(link::UniqueFd fd, std::unique_ptr<Dialect> dialect, std::string name)
    : fd_{std::move(fd)}, dialect_{std::move(dialect)}, name_{std::move(name)} {
  dialect_->greet(out_);
  flush();
}

void Client::read(std::size_t room, std::vector<can::CanFrame>& sent) {
  fill_in();
  if (holds_ && !in_.empty()) release_held();
  const bool was_looking_on = is_looking_on();
  const std::size_t before = sent.size();
  in_.erase(0, dialect_->hear(in_, room, out_, sent));
  // What it said before it went still counts: it may have sent a burst and closed.
  gone_ = has_hung_up_ && (in_.empty() || sent.size() - before < room);
  if (is_looking_on() && !was_looking_on) {
    holds_ = true;
    hold_until_ = runtime::read_monotonic() + kHold;
  }
  flush();
}

void Client::fill_in() {
  while (!has_hung_up_ && in_.size() < kMaxUnread) {
    std::array<char, kMaxUnread> bytes;
    const ssize_t size = ::read(fd_.get(), bytes.data(), bytes.size() - in_.size());
    if (size > 0) {
      in_.append(bytes.data(), static_cast<std::size_t>(size));
    } else {
      has_hung_up_ = size == 0 || (errno != EAGAIN && errno != EINTR);
      return;
    }
  }
}

void Client::show(const can::StampedFrame& frame) {
  if (!is_looking_on() || is_deaf_) return;
  if (out_.size() - sent_size_ + held_.size() > kMaxBacklog) {
    ++dropped_frames_;
    return;
  }
  dialect_->tell(frame, holds_ ? held_ : out_);
}

void Client::flush() {
  if (holds_ && runtime::read_monotonic() >= hold_until_) release_held();
  while (sent_size_ < out_.size()) {
    int in_flight = 0;
    if (::ioctl(fd_.get(), TIOCOUTQ, &in_flight) == 0 && in_flight > kMaxInFlight) return;
    std::size_t end = std::min(out_.size(), sent_size_ + kPiece);
    if (end < out_.size()) end = out_.find_last_of("\n\r>", end - 1) + 1;  // npos + 1 = 0: not in out_, see tell().
    const ssize_t size = write_some(fd_.get(), out_.data() + sent_size_, end - sent_size_);
    if (size < 0) {
      if (errno != EAGAIN && errno != EINTR) {
        is_deaf_ = true;
        sent_size_ = out_.size();
      }
      break;
    }
    sent_size_ += static_cast<std::size_t>(size);
    handed_bytes_ += static_cast<std::uint64_t>(size);
  }
  if (sent_size_ == out_.size() || sent_size_ > kMaxBacklog) {
    out_.erase(0, sent_size_);
    sent_size_ = 0;
  }
}

std::string Client::complaint() const {
  const std::uint64_t lost = lost_frames();
  return lost == 0 ? "" : fmt::format("{} read too slowly and lost {} frames", name_, lost);
}

/// Frames that it would not take in time, and those that wait for it still.
std::uint64_t Client::lost_frames() const {
  // One line each; an answer that was not read, either, is not worth telling apart.
  const auto ends_line = [](char c) { return c == '\n' || c == '\r'; };
  const auto unread = std::count_if(out_.begin() + static_cast<std::ptrdiff_t>(sent_size_), out_.end(), ends_line) +
                      std::ranges::count_if(held_, ends_line);
  return dropped_frames_ + static_cast<std::uint64_t>(unread);
}

void Client::release_held() {
  holds_ = false;
  out_ += held_;
  held_.clear();
}

}  // namespace meltbench::tap
