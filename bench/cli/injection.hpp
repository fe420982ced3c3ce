#pragma once

#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "bench/bus/run_observer.hpp"
#include "bench/fault/faulty_port.hpp"
#include "bench/fault/injector.hpp"
#include "protocols/runtime/participant_port.hpp"

namespace meltbench::cli {

/// A participant of a run, as its faults know it.
struct Member {
  std::string_view name;
  std::vector<SignalInfo> signals;  ///< As rows have them.
  std::span<const std::string> lines;
};

/// The faults of a run. @param members  by number.  @param observer  outlives it: gets their begins and ends.
/// @throws config::ConfigError if a fault waits for a signal that is not there.
[[nodiscard]] std::unique_ptr<fault::Injector> make_injector(std::vector<fault::Fault> faults, std::uint64_t seed,
                                                             std::span<const Member> members,
                                                             bus::RunObserver& observer);

/// The faults of a run in virtual time, put around its participants.
class Injection {
 public:
  /// @param ports, observer  of the run; outlive this object. Else as make_injector().
  Injection(std::vector<fault::Fault> faults, std::uint64_t seed, std::span<runtime::ParticipantPort* const> ports,
            bus::RunObserver& observer);

  /// To be run in place of the ports themselves.
  [[nodiscard]] std::span<runtime::ParticipantPort* const> ports() const { return ports_; }
  [[nodiscard]] fault::Injector& injector() { return *injector_; }

 private:
  std::unique_ptr<fault::Injector> injector_;
  std::vector<std::unique_ptr<fault::FaultyPort>> faulty_;
  std::vector<runtime::ParticipantPort*> ports_;
};

}  // namespace meltbench::cli
