#pragma once

#include "protocols/link/can_link.hpp"

namespace meltbench::link {

/// No CAN bus at all, for machines that have serial boards only: what is sent is gone, and nothing ever arrives.
class NoCanLink final : public CanLink {
 public:
  [[nodiscard]] SendStatus send(const can::CanFrame&) noexcept override { return SendStatus::kSent; }
  [[nodiscard]] std::optional<ReceivedFrame> receive() noexcept override { return std::nullopt; }
  [[nodiscard]] bool is_up() noexcept override { return true; }
  [[nodiscard]] int fd() const noexcept override { return -1; }
  [[nodiscard]] const LinkCounters& counters() const noexcept override { return counters_; }

 private:
  LinkCounters counters_;
};

}  // namespace meltbench::link
