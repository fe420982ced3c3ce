#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "bench/tap/dialect.hpp"
#include "protocols/link/unique_fd.hpp"

namespace meltbench::tap {

/// Bytes that wait for a client at most; about 100,000 frames. What comes on top of that is lost for it, and counted.
inline constexpr std::size_t kMaxBacklog = 4U << 20U;

/// One of other people's programs, connected: its descriptor, its language, and what it has not read yet.
/// Nothing here waits for it.
class Client {
 public:
  /// @param fd    non-blocking stream.  @param name  for people.
  Client(link::UniqueFd fd, std::unique_ptr<Dialect> dialect, std::string name);

  /// Takes what it has sent: at most `room` frames; further ones stay in its own queue. Answers it,
  /// and hands over what waits as far as it takes it.
  void read(std::size_t room, std::vector<can::CanFrame>& sent);

  /// Queues a frame that was on the bus, if it wants to see the bus.
  void show(const can::StampedFrame& frame);

  [[nodiscard]] int fd() const { return fd_.get(); }
  [[nodiscard]] bool is_gone() const { return gone_; }
  [[nodiscard]] bool wants_frames() const { return dialect_->wants_frames(); }
  /// Something waits for it that it would not take.
  [[nodiscard]] bool has_backlog() const { return sent_size_ < out_.size() || !held_.empty(); }
  [[nodiscard]] const std::string& name() const { return name_; }
  /// Handed over so far; grows while it reads.
  [[nodiscard]] std::uint64_t handed_bytes() const { return handed_bytes_; }
  /// Frames that it would not take in time, and those that wait for it still.
  [[nodiscard]] std::uint64_t lost_frames() const;

 private:
  void fill_in();
  void flush();
  void release_held();

  link::UniqueFd fd_;
  std::unique_ptr<Dialect> dialect_;
  std::string name_;
  std::string in_;   ///< Said, not yet understood.
  std::string out_;  ///< To be handed over, of which sent_size_ bytes are.
  std::size_t sent_size_ = 0;
  std::string held_;  ///< Frames that must not follow the last answer at once.
  Nanos hold_until_{};
  bool holds_ = false;
  bool has_hung_up_ = false;  ///< Nothing more will come.
  bool is_deaf_ = false;      ///< Takes nothing more.
  bool gone_ = false;
  std::uint64_t handed_bytes_ = 0;
  std::uint64_t dropped_frames_ = 0;
};

}  // namespace meltbench::tap
