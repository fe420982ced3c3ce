#include "controller/machine/zone_tuning.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "controller/machine/objects.hpp"

namespace meltbench::machine {

namespace {

using canopen::SdoStep;

std::string name_of(std::size_t channel) {
  return channel == kNozzleChannel ? "nozzle" : fmt::format("zone {}", channel);
}

template <class T>
SdoStep read(std::uint16_t index, std::size_t channel, std::string purpose) {
  return {
      SdoStep::Kind::kRead, {index, static_cast<std::uint8_t>(channel)}, canopen::to_bytes(T{}), std::move(purpose)};
}

}  // namespace

void ZoneTuning::note(std::size_t channel, std::uint8_t zone_state) {
  const bool runs = (zone_state & heater_object::kZoneTunes) != 0;
  Phase& now = phase(channel);
  if (runs && now != Phase::kAsked) now = Phase::kRunning;
  if (!runs && now == Phase::kRunning) now = Phase::kEnded;
}

void ZoneTuning::update(Instant now, NodeBoot& heater, Outbox& out) {
  if (heater.is_writing()) return;
  if (reading_) {
    tell_outcome(now, *reading_, heater, out);
    reading_.reset();
  }
  for (std::size_t channel = 1; channel <= kMaxZones; ++channel) {
    if (phase(channel) == Phase::kAsked) return start(now, channel, heater, out);
    if (phase(channel) == Phase::kEnded) return read_outcome(now, channel, heater, out);
  }
}

void ZoneTuning::start(Instant now, std::size_t channel, NodeBoot& heater, Outbox& out) {
  phase(channel) = Phase::kStarting;
  out.report(Severity::kInfo, now, "autotune",
             fmt::format("{}: the board tries it out with a relay", name_of(channel)));
  std::vector<SdoStep> steps;
  steps.push_back(canopen::write_step(heater_object::kAutotune, static_cast<std::uint8_t>(channel), std::uint8_t{1},
                                      "autotune of " + name_of(channel)));
  heater.write(now, std::move(steps), out.frame_queue());
}

void ZoneTuning::read_outcome(Instant now, std::size_t channel, NodeBoot& heater, Outbox& out) {
  using namespace heater_object;
  phase(channel) = Phase::kIdle;
  reading_ = channel;
  heater.write(now,
               {read<std::uint8_t>(kAutotuneState, channel, "autotune state"),
                read<std::int16_t>(kProportionalBand, channel, "proportional band"),
                read<std::int16_t>(kIntegralTime, channel, "integral time"),
                read<std::int16_t>(kDerivativeTime, channel, "derivative time")},
               out.frame_queue());
}

void ZoneTuning::tell_outcome(Instant now, std::size_t channel, const NodeBoot& heater, Outbox& out) const {
  constexpr double kTenth = 0.1;
  const auto state = heater.read_later<std::uint8_t>(0);
  const auto band = heater.read_later<std::int16_t>(1);
  const auto integral = heater.read_later<std::int16_t>(2);
  const auto derivative = heater.read_later<std::int16_t>(3);
  if (!state || !band || !integral || !derivative) return;  // The bus manager has told that reading failed.
  const bool done = *state == heater_object::kAutotuneDone;
  out.report(done ? Severity::kInfo : Severity::kWarning, now, "autotune-over",
             fmt::format("{}: {}; band {:.1f} K, integral {:.1f} s, derivative {:.1f} s", name_of(channel),
                         done ? "tuned" : "not tuned, the board keeps what it had", kTenth * *band, kTenth * *integral,
                         kTenth * *derivative));
}

}  // namespace meltbench::machine
