#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "bench/tap/dialect.hpp"
#include "bench/tap/visitor.hpp"
#include "protocols/link/unique_fd.hpp"

namespace meltbench::tap {

/// Bytes that wait for a client at most; about 100,000 frames. What comes on top of that is lost for it, and counted.
inline constexpr std::size_t kMaxBacklog = 4U << 20U;

/// One of other people's programs, connected: its descriptor, its language, and what it has not read yet.
/// Nothing here waits for it.
class Client final : public Visitor {
 public:
  /// @param fd    non-blocking stream.  @param name  for people.
  Client(link::UniqueFd fd, std::unique_ptr<Dialect> dialect, std::string name);

  /// Takes what it has sent: at most `room` frames; further ones stay in its own queue. Answers it,
  /// and hands over what waits as far as it takes it.
  void read(std::size_t room, std::vector<can::CanFrame>& sent) override;

  /// Queues a frame that was on the bus, if it wants to see the bus.
  void show(const can::StampedFrame& frame) override;

  [[nodiscard]] int fd() const override { return fd_.get(); }
  [[nodiscard]] bool is_gone() const override { return gone_; }
  [[nodiscard]] bool is_looking_on() const override { return dialect_->wants_frames(); }
  [[nodiscard]] bool has_backlog() const override { return sent_size_ < out_.size() || !held_.empty(); }
  /// In bytes.
  [[nodiscard]] std::uint64_t handed() const override { return handed_bytes_; }
  [[nodiscard]] std::string complaint() const override;

 private:
  [[nodiscard]] std::uint64_t lost_frames() const;
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
