#pragma once
/// The device side of a line: one or several units that answer requests.

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "protocols/modbus/frame_reader.hpp"
#include "protocols/modbus/pdu.hpp"
#include "protocols/modbus/register_map.hpp"

namespace meltbench::modbus {

/// What a unit answers to a request. Checked in the specification's order: function, quantity and form of the values,
/// addresses, then execution. Function 23 is checked as a whole before it writes.
/// @returns the answer, empty if the request is cut off (then a device is silent).
[[nodiscard]] Pdu execute(Instant now, std::span<const std::uint8_t> request, RegisterMap& map);

/// Units on one line. A request is executed at the instant of its end; its answer leaves after the unit's answer delay,
/// at least t3_5. Broken frames and foreign units are met with silence; broadcasts are executed by all and answered by
/// none. A request that comes before the answer to the last one has left takes its place.
/// Real time: no allocation after add(), but for what the caller's byte queue needs.
class RtuServer {
 public:
  explicit RtuServer(const LineTiming& timing) : timing_{timing}, reader_{Direction::kRequests, timing} {}

  /// @param map  must outlive the server.  @pre 1 <= unit <= kMaxUnit, once on the line.
  void add(std::uint8_t unit, RegisterMap& map, Nanos answer_delay = Nanos{});

  /// A unit without power hears and says nothing; what it was about to say is lost. No effect for one that is not here.
  void set_present(std::uint8_t unit, bool present);
  /// On top of the unit's answer delay.
  void set_extra_delay(std::uint8_t unit, Nanos delay);

  /// Bytes that came without a gap, the last one at `at`. @pre `at` is not before any earlier instant told.
  void on_bytes(Instant at, std::span<const std::uint8_t> bytes);
  /// Ends frames by silence and appends what is due to `out`.
  void on_time(Instant now, std::vector<std::uint8_t>& out);
  [[nodiscard]] Instant next_deadline() const;

  /// The line was lost: forgets what was under way.
  void reset();

  [[nodiscard]] std::uint64_t requests() const { return requests_; }      ///< For a unit of ours.
  [[nodiscard]] std::uint64_t exceptions() const { return exceptions_; }  ///< Refused ones among them.
  [[nodiscard]] std::uint64_t frames_lost() const { return reader_.frames_lost(); }

 private:
  struct Unit {
    std::uint8_t unit;
    RegisterMap* map;
    Nanos answer_delay;
    Nanos extra_delay{};
    bool present = true;
  };
  [[nodiscard]] Unit* find(std::uint8_t unit);
  void handle(Instant now, const Frame& frame);

  LineTiming timing_;
  FrameReader reader_;
  std::vector<Unit> units_;
  Pdu answer_;
  std::uint8_t answering_ = 0;
  Instant answer_at_ = Instant::never();
  std::uint64_t requests_ = 0;
  std::uint64_t exceptions_ = 0;
};

}  // namespace meltbench::modbus
