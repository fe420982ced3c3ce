#pragma once

#include <deque>
#include <vector>

#include "protocols/link/can_link.hpp"

namespace meltbench::test {

/// A classic CAN bus whose queue, plug and traffic are the test's.
class FakeCanLink final : public link::CanLink {
 public:
  link::SendStatus send(const can::CanFrame& frame) noexcept override {
    if (!up) return link::SendStatus::kDown;
    if (frame.fd) return link::SendStatus::kUnsupported;
    if (room == 0) return link::SendStatus::kFull;
    --room;
    sent.push_back(frame);
    return link::SendStatus::kSent;
  }
  std::optional<link::ReceivedFrame> receive() noexcept override {
    if (received.empty()) return std::nullopt;
    const link::ReceivedFrame frame{{}, received.front()};
    received.pop_front();
    return frame;
  }
  bool is_up() noexcept override {
    ++looks;
    return up;
  }
  [[nodiscard]] int fd() const noexcept override { return -1; }
  [[nodiscard]] const link::LinkCounters& counters() const noexcept override { return counted; }

  [[nodiscard]] std::vector<std::uint32_t> sent_ids() const {
    std::vector<std::uint32_t> ids;
    for (const can::CanFrame& frame : sent) ids.push_back(frame.id);
    return ids;
  }

  bool up = true;
  int looks = 0;
  std::size_t room = 100'000;
  std::vector<can::CanFrame> sent;
  std::deque<can::CanFrame> received;
  link::LinkCounters counted;
};

}  // namespace meltbench::test
