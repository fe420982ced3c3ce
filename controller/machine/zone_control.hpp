#pragma once
/// The heated zones on the bus: what the heater board is told, and what it reports, watched.

#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "controller/machine/serial_zone.hpp"
#include "controller/machine/settings.hpp"
#include "controller/machine/trouble.hpp"
#include "controller/machine/zone_settings.hpp"
#include "controller/machine/zone_tuning.hpp"
#include "protocols/participant/participant.hpp"

namespace meltbench::machine {

/// The board holds the temperatures itself; the controller gives set points and release, and believes the board as far
/// as heat follows power. Per cycle: take() frames, then tell(); judge() after frames have come.
/// Real time: no allocation but for a trouble.
class ZoneControl {
 public:
  /// @pre settings.zones.
  explicit ZoneControl(const ControllerSettings& settings);

  /// The zones' own units, if the heater is on a serial line; else none.
  [[nodiscard]] std::span<const std::unique_ptr<SerialZone>> serial() const { return serial_; }

  /// @returns true if the frame was for it.
  bool take(const can::CanFrame& frame, Instant now);
  /// Why the heaters must go off. Ages count from `ready_at` on.
  [[nodiscard]] std::optional<Trouble> judge(Instant now, Instant ready_at);

  void release(bool on) { released_ = on; }
  [[nodiscard]] bool is_released() const { return released_; }
  /// Set points and release, every kZoneReportPeriod; at once if the release has changed.
  void tell(Instant now, Outbox& out);

  [[nodiscard]] ZoneTuning& tuning() { return tuning_; }

  /// The set point of all barrel zones.
  void set_barrel(double T_degC);
  /// All zones are reported and within the band.
  [[nodiscard]] bool is_warm() const;
  /// Mean over the barrel zones; nothing while one of them is not known.
  [[nodiscard]] std::optional<double> T_barrel_degC() const;

  /// Coldest barrel zone that reaches beyond `share` of the barrel's length; nothing while none is known.
  [[nodiscard]] std::optional<double> T_coldest_beyond_degC(double share) const;

  [[nodiscard]] std::size_t zone_count() const { return zones_.size(); }
  [[nodiscard]] std::size_t channel(std::size_t zone) const { return zones_[zone].set.channel; }
  [[nodiscard]] double set_degC(std::size_t zone) const { return zones_[zone].set.set_degC; }
  [[nodiscard]] double T_degC(std::size_t zone) const { return zones_[zone].report.T_degC; }
  [[nodiscard]] double output(std::size_t zone) const { return zones_[zone].report.output; }

 private:
  struct Zone {
    ZoneSettings::Zone set;
    safety::ZoneWatch watch;
    safety::ZoneReport report;
    bool fresh = false;  // Reported, and not yet judged.
    bool seen = false;   // Reported ever.
    Instant reported_at;
  };
  void take_temperature(std::size_t channel, const can::CanFrame& frame, bool second, Instant now);
  void take_serial_reports();
  void take_output(std::size_t channel, const can::CanFrame& frame, std::size_t byte);
  [[nodiscard]] Zone* find(std::size_t channel);
  [[nodiscard]] static std::string name_of(const Zone& zone);

  ZoneSettings settings_;
  std::uint8_t node_id_;
  unsigned syncs_per_report_;
  std::vector<Zone> zones_;
  std::vector<std::unique_ptr<SerialZone>> serial_;  // In the order of zones_, or none.
  ZoneTuning tuning_;
  bool released_ = false;
  bool told_released_ = false;
  unsigned syncs_until_told_ = 0;
};

}  // namespace meltbench::machine
