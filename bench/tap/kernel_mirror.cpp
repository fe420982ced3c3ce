#include "bench/tap/kernel_mirror.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "protocols/link/can_interface.hpp"
#include "protocols/runtime/real_time_clock.hpp"

namespace meltbench::tap {

KernelMirror::KernelMirror(std::unique_ptr<link::CanLink> link, std::string name, bool is_virtual, bool read_only)
    : link_{std::move(link)},
      gateway_{*link_},
      name_{std::move(name)},
      is_virtual_{is_virtual},
      read_only_{read_only} {}

void KernelMirror::read(std::size_t room, std::vector<can::CanFrame>& sent) {
  exchange();
  for (; room > 0 && !arrived_.empty(); --room) {
    sent.push_back(arrived_.front());
    arrived_.pop_front();
  }
}

void KernelMirror::show(const can::StampedFrame& frame) {
  if (frame.frame.kind == can::FrameKind::kError && !is_virtual_) return;
  ++shown_;
  gateway_.send(frame.frame);
  exchange();  // At once: who looks on there has the kernel's stamps only.
}

void KernelMirror::exchange() {
  received_.clear();
  events_.clear();
  gateway_.exchange(Instant{runtime::read_monotonic()}, received_, events_);
  if (read_only_) return;
  for (const link::ReceivedFrame& received : received_) {
    if (received.frame.kind == can::FrameKind::kError) continue;
    if (arrived_.size() < kMaxWaiting)
      arrived_.push_back(received.frame);
    else
      ++not_taken_;
  }
}

std::string KernelMirror::complaint() const {
  std::string text;
  // What the kernel has dropped is on its way from there, and counted by the gateway with the rest.
  if (const std::uint64_t lost = gateway_.lost_frames() + gateway_.waiting(); lost > 0) {
    text = fmt::format("{} was full or away, frames lost: {}", name_, lost);
  }
  if (not_taken_ > 0) {
    text += fmt::format("{}frames from {} that came faster than the bus takes them, and are lost: {}",
                        text.empty() ? "" : "; ", name_, not_taken_);
  }
  return text;
}

std::unique_ptr<KernelMirror> open_kernel_mirror(const std::string& name, bool read_only) {
  auto link = link::open_can_link({link::BusUri::Kind::kSocketCan, name});
  const std::vector<link::CanInterface> interfaces = link::list_can_interfaces();
  const auto found = std::ranges::find(interfaces, name, &link::CanInterface::name);
  const bool is_virtual = found != interfaces.end() && (found->kind == "vcan" || found->kind == "vxcan");
  return std::make_unique<KernelMirror>(std::move(link), name, is_virtual, read_only);
}

}  // namespace meltbench::tap
