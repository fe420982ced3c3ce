#pragma once

#include <deque>
#include <memory>

#include "bench/bus/gateway.hpp"
#include "bench/tap/visitor.hpp"

namespace meltbench::tap {

/// The embedded bus on a kernel interface: every program there sees its frames at the pace of the run, so that candump
/// records, in the kernel's time, what a vcan cannot do by itself: arbitration, bit errors, bus-off. What such programs
/// send is on the embedded bus as soon as it takes it; that it came so late they do not see.
///
/// Frames that the interface does not take wait for it as bus::Gateway has it. Error frames go out where they stay on
/// this machine; a real controller would send something else in their place. Error frames from there stay there.
class KernelMirror final : public Visitor {
 public:
  /// Frames from there that wait for the run at most; further ones are lost, and counted.
  static constexpr std::size_t kMaxWaiting = 1024;

  /// @param link       of the interface.  @param name  for people.
  /// @param is_virtual the interface has no wire: vcan, vxcan.
  /// @param read_only  what comes from there is not taken.
  KernelMirror(std::unique_ptr<link::CanLink> link, std::string name, bool is_virtual, bool read_only);

  void read(std::size_t room, std::vector<can::CanFrame>& sent) override;
  void show(const can::StampedFrame& frame) override;

  [[nodiscard]] int fd() const override { return gateway_.fd(); }
  [[nodiscard]] bool is_gone() const override { return false; }
  /// The kernel does not tell who looks at an interface.
  [[nodiscard]] bool is_looking_on() const override { return false; }
  [[nodiscard]] bool has_backlog() const override { return gateway_.has_waiting(); }
  [[nodiscard]] std::uint64_t handed() const override { return shown_ - gateway_.waiting(); }
  [[nodiscard]] std::string complaint() const override;

 private:
  void exchange();

  std::unique_ptr<link::CanLink> link_;
  bus::Gateway gateway_;
  std::string name_;
  bool is_virtual_;
  bool read_only_;
  std::deque<can::CanFrame> arrived_;
  std::uint64_t shown_ = 0;
  std::uint64_t not_taken_ = 0;  ///< Of what came from there.
  std::vector<link::ReceivedFrame> received_;
  std::vector<Event> events_;
};

/// @param name  of a kernel interface, e.g. "vcan0".
/// @throws link::LinkError with the reason and what to do: no CAN in the kernel, no such interface, not up.
[[nodiscard]] std::unique_ptr<KernelMirror> open_kernel_mirror(const std::string& name, bool read_only);

}  // namespace meltbench::tap
