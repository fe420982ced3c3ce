#pragma once
/// Heartbeat: who is alive, and in which state.

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "protocols/canopen/types.hpp"

namespace meltbench::canopen {

/// Boot-up message (kInitialising) or heartbeat of a node.
[[nodiscard]] can::CanFrame make_heartbeat(std::uint8_t node, NmtState state);

enum class HeartbeatChange : std::uint8_t {
  kFirst,   ///< First sign of life since it is watched; the time-out runs from now on.
  kBootUp,  ///< Boot-up message: the node has been reset.
  kState,   ///< It is in another NMT state than before.
  kLost,    ///< No heartbeat for the time-out.
  kBack,    ///< First sign of life after it was lost; state kInitialising = it was a boot-up message.
};

struct HeartbeatEvent {
  std::uint8_t node = 0;
  HeartbeatChange change{};
  NmtState state{};  ///< As last heard.
};

/// Watches heartbeats. Silent until a node was heard for the first time, as CiA 301 wants it: who must boot is the
/// manager's own time-out. A boot-up message counts as a heartbeat.
class HeartbeatConsumer {
 public:
  /// Starts, changes or (timeout 0) ends watching a node; the node counts as not yet heard. @pre 1 <= node <= 127.
  void watch(std::uint8_t node, Nanos timeout);

  /// As watch(), but the time-out runs from `now` even if the node is never heard.
  void watch_from(Instant now, std::uint8_t node, Nanos timeout);
  void clear();

  /// @returns what has changed by this frame, if it is a heartbeat of a watched node. kBack beats kState.
  std::optional<HeartbeatEvent> on_frame(Instant now, const can::CanFrame& frame);

  /// One node that is lost as of now; call until it returns nothing.
  std::optional<HeartbeatEvent> take_lost(Instant now);

  [[nodiscard]] Instant next_deadline() const { return deadline_; }
  [[nodiscard]] bool is_watched(std::uint8_t node) const;
  [[nodiscard]] bool is_alive(std::uint8_t node) const;                  ///< Heard, and not lost since.
  [[nodiscard]] std::optional<NmtState> state(std::uint8_t node) const;  ///< As last heard.

 private:
  struct Watched {
    std::uint8_t node = 0;
    Nanos timeout{};
    Instant expires = Instant::never();
    bool heard = false;
    bool lost = false;
    NmtState state{};
  };
  [[nodiscard]] const Watched* find(std::uint8_t node) const;
  void update_deadline();

  std::vector<Watched> watched_;
  Instant deadline_ = Instant::never();
};

}  // namespace meltbench::canopen
