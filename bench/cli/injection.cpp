#include "bench/cli/injection.hpp"

#include <string_view>
#include <utility>

namespace meltbench::cli {

Injection::Injection(std::vector<fault::Fault> faults, std::uint64_t seed,
                     std::span<runtime::ParticipantPort* const> ports, bus::RunObserver& observer) {
  std::vector<SignalInfo> signals;
  std::vector<std::string_view> names;
  std::size_t emulator = 0;
  for (const runtime::ParticipantPort* port : ports) {
    if (port->name() == "plant") emulator = names.size();
    names.push_back(port->name());
    signals.insert(signals.end(), port->signals().begin(), port->signals().end());
  }
  const auto report = [&observer](const Event& event) { observer.on_event(bus::kOutsideSender, event); };
  std::vector<std::string> lines;
  if (!ports.empty()) lines.assign(ports[emulator]->lines().begin(), ports[emulator]->lines().end());
  injector_ = std::make_unique<fault::Injector>(
      std::move(faults), fault::Injector::Setup{seed, signals, names, emulator, report, std::move(lines)});
  for (std::size_t number = 0; number < ports.size(); ++number) {
    faulty_.push_back(std::make_unique<fault::FaultyPort>(*ports[number], injector_->condition_of(number)));
    ports_.push_back(faulty_.back().get());
  }
}

}  // namespace meltbench::cli
