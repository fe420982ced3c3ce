#include "controller/machine/feeder_wire.hpp"

#include <cmath>

#include "controller/machine/boot_plan.hpp"
#include "controller/machine/objects.hpp"

namespace meltbench::machine {

namespace {

constexpr double kSecondsPerHour = 3600.0;

}  // namespace

FeederFacts CanFeeder::facts(const BusManager& bus) const {
  const NodeBoot& boot = bus.boot(config::BoardKind::kFeeder);
  return {.latency = boot.value<std::uint32_t>(feeder_object::kLatency) * 1us,
          .cycle = boot.value<std::uint32_t>(feeder_object::kControlCycle) * 1us};
}

bool CanFeeder::take(const can::CanFrame& frame, Instant sync_at) {
  if (frame.id != canopen::cob_id::tpdo(feeder_object::kReportTpdo, node_id_)) return false;
  const auto report = parse_feeder_report(frame);
  if (report && std::isfinite(report->flow_kg_per_h)) {
    std::optional<Nanos> age;
    if (report->age_10us != kAgeSaturated) age = report->age_10us * 10us;
    sample_ = {sync_at, static_cast<double>(report->flow_kg_per_h) / kSecondsPerHour, age, report->changes};
  }
  return true;
}

void CanFeeder::command(Instant now, double flow_kg_per_s, Outbox& out) {
  out.send(make_feed_command(node_id_, static_cast<float>(flow_kg_per_s * kSecondsPerHour)));
  sent_ = {now, flow_kg_per_s};
}

void CanFeeder::set_safe_flow(Instant now, double flow_kg_per_s, BusManager& bus, Outbox& out) {
  bus.boot(config::BoardKind::kFeeder)
      .write(now, {make_loss_of_master_step(flow_kg_per_s * kSecondsPerHour)}, out.frame_queue());
}

}  // namespace meltbench::machine
