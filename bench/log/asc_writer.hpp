#pragma once

#include "bench/log/channel_numbers.hpp"
#include "bench/log/log_writer.hpp"

namespace meltbench::log {

/// The text log of Vector's tools, hexadecimal, absolute stamps of microseconds from the first frame on; the date of
/// that frame, as UTC, in the head. The class of an error frame cannot be written in this format.
class AscWriter final : public LogWriter {
 public:
  explicit AscWriter(std::unique_ptr<ByteSink> sink) : sink_{std::move(sink)} {}
  void write(const LogEntry& entry, std::string_view channel) override;
  void finish() override;

 private:
  void begin(Instant start);
  void append_classic(const LogEntry& entry, unsigned channel);
  void append_fd(const LogEntry& entry, unsigned channel);

  std::unique_ptr<ByteSink> sink_;
  ChannelNumbers channels_;
  std::string text_;
  Instant start_{};
  bool begun_ = false;
};

}  // namespace meltbench::log
