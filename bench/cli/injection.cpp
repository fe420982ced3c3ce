#include "bench/cli/injection.hpp"

#include <algorithm>
#include <utility>

namespace meltbench::cli {

std::unique_ptr<fault::Injector> make_injector(std::vector<fault::Fault> faults, std::uint64_t seed,
                                               std::span<const Member> members, bus::RunObserver& observer) {
  std::vector<SignalInfo> signals;
  std::vector<std::string_view> names;
  for (const Member& member : members) {
    names.push_back(member.name);
    signals.insert(signals.end(), member.signals.begin(), member.signals.end());
  }
  const auto report = [&observer](const Event& event) { observer.on_event(bus::kOutsideSender, event); };
  const auto found = std::ranges::find(names, "plant");
  const std::size_t emulator = found == names.end() ? 0 : static_cast<std::size_t>(found - names.begin());
  std::vector<std::string> lines;
  if (!members.empty()) lines.assign(members[emulator].lines.begin(), members[emulator].lines.end());
  return std::make_unique<fault::Injector>(
      std::move(faults), fault::Injector::Setup{seed, signals, names, emulator, report, std::move(lines)});
}

Injection::Injection(std::vector<fault::Fault> faults, std::uint64_t seed,
                     std::span<runtime::ParticipantPort* const> ports, bus::RunObserver& observer) {
  std::vector<Member> members;
  for (const runtime::ParticipantPort* port : ports) {
    members.push_back({port->name(), {port->signals().begin(), port->signals().end()}, port->lines()});
  }
  injector_ = make_injector(std::move(faults), seed, members, observer);
  for (std::size_t number = 0; number < ports.size(); ++number) {
    faulty_.push_back(std::make_unique<fault::FaultyPort>(*ports[number], injector_->condition_of(number)));
    ports_.push_back(faulty_.back().get());
  }
}

}  // namespace meltbench::cli
