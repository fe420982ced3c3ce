#pragma once

#include "bench/log/log_writer.hpp"

namespace meltbench::log {

/// candump -l text. Directions are left out: tshark and older can-utils read no line that has one. A channel that is a
/// number, as of ASC and BLF, becomes an interface: "1" is "can0".
class CandumpWriter final : public LogWriter {
 public:
  explicit CandumpWriter(std::unique_ptr<ByteSink> sink) : sink_{std::move(sink)} {}
  void write(const LogEntry& entry, std::string_view channel) override;
  void finish() override;

 private:
  std::unique_ptr<ByteSink> sink_;
  std::string text_;
};

}  // namespace meltbench::log
