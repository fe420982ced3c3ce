#pragma once

#include <memory>
#include <span>
#include <vector>

#include "bench/bus/run_observer.hpp"
#include "bench/fault/faulty_port.hpp"
#include "bench/fault/injector.hpp"
#include "protocols/runtime/participant_port.hpp"

namespace meltbench::cli {

/// The faults of one run, put around its participants.
class Injection {
 public:
  /// @param ports, observer  of the run; outlive this object. Begins and ends of faults go to the observer.
  /// @throws config::ConfigError if a fault waits for a signal that is not there.
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
