#include "bench/cli/memory_run.hpp"

#include <array>
#include <utility>

#include "bench/cli/injection.hpp"

namespace meltbench::cli {
namespace {

RunRequest make_request() {
  RunRequest request;
  request.pace.kind = Pace::Kind::kInProcess;
  request.pace_given = true;
  return request;
}

}  // namespace

MemoryRun::MemoryRun(scenario::ResolvedRun run)
    : prepared_{prepare(std::move(run), {}, make_request())},
      controller_{*prepared_.controller},
      plant_{*prepared_.plant} {}

std::vector<SignalInfo> MemoryRun::signals() const {
  std::vector<SignalInfo> signals{controller_.signals().begin(), controller_.signals().end()};
  signals.insert(signals.end(), plant_.signals().begin(), plant_.signals().end());
  return signals;
}

bus::RunOutcome MemoryRun::play(bus::RunObserver& observer) {
  const std::array<runtime::ParticipantPort*, 2> ports{&controller_, &plant_};
  Injection faults{prepared_.faults, prepared_.run.seed, ports, observer};
  bus::RunMedia media = bus::make_media(rig());
  media.intervention = &faults.injector();
  return bus::VirtualTime{faults.ports(), prepared_.run.record_period, observer, media}.run(prepared_.run.duration);
}

}  // namespace meltbench::cli
