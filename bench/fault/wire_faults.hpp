#pragma once
/// Faults of the wires themselves: the bit-timed bus and the serial lines.

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "bench/bus/intervention.hpp"
#include "bench/bus/serial_line.hpp"
#include "protocols/fault/fault.hpp"

namespace meltbench::fault {

/// Noise, drop-outs and stalls of one line, in the order in which they began.
class LineFaults final : public bus::LineFault {
 public:
  struct Active {
    std::size_t number = 0;
    Kind kind{};
    double value = 0.0;  ///< Share of bytes, or milliseconds.
    std::uint64_t seed = 0;
    std::uint64_t drawn = 0;
  };
  [[nodiscard]] Nanos strike(Instant now, std::size_t sender, std::vector<std::uint8_t>& bytes) override;

  std::vector<Active> active;
};

/// Turns faults of `bus` and `line` targets into the hooks that bus and lines have for them.
class WireFaults {
 public:
  /// @param emulator  number of the participant whose plug is pulled; @param lines  how it numbers its lines.
  WireFaults(std::size_t emulator, std::vector<std::string> lines) : emulator_{emulator}, lines_{std::move(lines)} {}

  void begin(std::size_t number, const Fault& fault, std::uint64_t seed, Instant now, bus::RunControl& run);
  void end(std::size_t number, const Fault& fault, Instant now, bus::RunControl& run);

 private:
  struct OfLine {
    std::string name;
    std::unique_ptr<LineFaults> faults;
  };
  void set_bus(const Fault& fault, std::uint64_t seed, bool on, Instant now, bus::RunControl& run) const;
  void plug(const std::string& line, bool in, bus::RunControl& run) const;
  [[nodiscard]] LineFaults& faults_of(const std::string& line);

  std::size_t emulator_;
  std::vector<std::string> lines_;
  std::vector<OfLine> of_lines_;
};

}  // namespace meltbench::fault
