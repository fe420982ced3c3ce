#pragma once
/// What the kernel says of its CAN interfaces: bit rate, state, error counters.

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace meltbench::link {

/// One kernel CAN interface. What a virtual one (vcan) does not have is missing.
struct CanInterface {
  std::string name;
  std::string kind;  ///< "can", "vcan", "vxcan"; empty if the kernel does not say.
  bool is_up = false;
  std::uint32_t queue_length = 0;  ///< Frames that may wait for sending (txqueuelen).
  std::optional<std::uint32_t> bit_rate_bit_per_s;
  std::optional<std::uint32_t> sample_point_permille;
  std::optional<std::uint32_t> data_bit_rate_bit_per_s;  ///< CAN FD only.
  std::optional<std::string_view>
      state;  ///< "error-active", "error-warning", "error-passive", "bus-off", "stopped" ...
  std::optional<std::uint16_t> tx_errors;  ///< Transmit error counter of the controller chip, 0..256.
  std::optional<std::uint16_t> rx_errors;
  std::optional<std::uint32_t> restart_ms;       ///< 0: after bus-off it stays off.
  std::optional<std::uint16_t> termination_ohm;  ///< Only of adapters that switch it themselves.
  std::optional<std::uint32_t> bus_errors;       ///< Since it was set up.
  std::optional<std::uint32_t> bus_offs;
  std::uint64_t rx_frames = 0;
  std::uint64_t tx_frames = 0;
  std::uint64_t rx_dropped = 0;  ///< By the kernel: nobody read in time.
  std::uint64_t tx_dropped = 0;
};

/// All CAN interfaces of this machine; none if the kernel cannot be asked.
[[nodiscard]] std::vector<CanInterface> list_can_interfaces();

/// Reads the answer to an rtnetlink dump of links (RTM_NEWLINK messages) and keeps those of CAN.
/// Never reads beyond `messages`, whatever they hold.
[[nodiscard]] std::vector<CanInterface> parse_can_interfaces(std::span<const std::uint8_t> messages);

}  // namespace meltbench::link
