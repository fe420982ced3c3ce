#include "bench/bus/run_media.hpp"

namespace meltbench::bus {

RunMedia make_media(const config::Rig& rig) {
  RunMedia media{.lines = rig.lines};
  if (rig.bus.fidelity == config::BusFidelity::kIdeal) return media;
  media.bit_timed = to_settings(rig.bus);
  media.clock_drifts.push_back({"controller", rig.controller_clock_drift_ppm});
  for (const config::RigBoard& board : rig.boards) media.clock_drifts.push_back({board.name, board.clock_drift_ppm});
  return media;
}

}  // namespace meltbench::bus
