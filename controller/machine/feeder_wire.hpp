#pragma once
/// The feeder as the loop of the filled length sees it, whatever wire it hangs on.

#include <optional>
#include <utility>

#include "controller/machine/bus_manager.hpp"
#include "controller/machine/feed_tracker.hpp"
#include "protocols/participant/participant.hpp"

namespace meltbench::machine {

class SerialUnit;

/// What a feeder says about itself, with the wire's own time in it.
struct FeederFacts {
  Nanos latency{};  ///< From the command to the changed flow, without the wait for the control cycle.
  Nanos cycle{};    ///< Its control cycle.
};

/// Per cycle: whatever came, take_sample(); command() or none; end_cycle().
class FeederWire {
 public:
  struct Sent {
    Instant at;
    double flow_kg_per_s = 0.0;
  };

  virtual ~FeederWire() = default;

  /// @pre it is configured.  @param bus  that has booted a feeder on CAN.
  [[nodiscard]] virtual FeederFacts facts(const BusManager& bus) const = 0;
  /// A report belongs to every SYNC; else they come at the wire's own pace.
  [[nodiscard]] virtual bool reports_at_sync() const = 0;

  /// @returns true if the frame was for it.
  virtual bool take(const can::CanFrame& /*frame*/, Instant /*sync_at*/) { return false; }
  /// It answers requests on a line, if it is such a one.
  [[nodiscard]] virtual SerialUnit* serial() { return nullptr; }

  /// Delivers this as soon as the wire lets it. What is the newest then wins.
  virtual void command(Instant now, double flow_kg_per_s, Outbox& out) = 0;
  /// What it is to deliver on loss of its master.
  virtual void set_safe_flow(Instant now, double flow_kg_per_s, BusManager& bus, Outbox& out) = 0;
  /// Everything that this cycle asks of it has been asked.
  virtual void end_cycle(Instant /*now*/) {}

  /// The newest report since the last call.
  [[nodiscard]] std::optional<FeedSample> take_sample() { return std::exchange(sample_, std::nullopt); }
  [[nodiscard]] bool has_sample() const { return sample_.has_value(); }
  /// The command that has left since the last call.
  [[nodiscard]] std::optional<Sent> take_sent() { return std::exchange(sent_, std::nullopt); }

 protected:
  std::optional<FeedSample> sample_;
  std::optional<Sent> sent_;
};

/// PDOs: a report at every SYNC, a set point as soon as it is known. Boots with the other boards of the bus.
class CanFeeder final : public FeederWire {
 public:
  explicit CanFeeder(std::uint8_t node_id) : node_id_{node_id} {}
  [[nodiscard]] FeederFacts facts(const BusManager& bus) const override;
  [[nodiscard]] bool reports_at_sync() const override { return true; }
  bool take(const can::CanFrame& frame, Instant sync_at) override;
  void command(Instant now, double flow_kg_per_s, Outbox& out) override;
  void set_safe_flow(Instant now, double flow_kg_per_s, BusManager& bus, Outbox& out) override;

 private:
  std::uint8_t node_id_;
};

}  // namespace meltbench::machine
