#pragma once

#include "bench/log/blf_format.hpp"
#include "bench/log/channel_numbers.hpp"
#include "bench/log/log_writer.hpp"

namespace meltbench::log {

/// Vector's binary log, packed with zlib. Stamps of nanoseconds from the first frame on, whose time is in the head to
/// the millisecond, as UTC; a log of bench time, which begins near zero, gets no date.
class BlfWriter final : public LogWriter {
 public:
  explicit BlfWriter(std::unique_ptr<ByteSink> sink);
  void write(const LogEntry& entry, std::string_view channel) override;
  void finish() override;

 private:
  template <typename Object>
  void append(Instant at, std::uint32_t type, const Object& object);
  void append_fd(const LogEntry& entry, unsigned channel);
  void write_container(std::size_t size);
  void write_bytes(std::string_view bytes);

  std::unique_ptr<ByteSink> sink_;
  ChannelNumbers channels_;
  blf::FileHeader header_;
  std::string plain_;
  std::string packed_;
  Instant start_{};
  bool begun_ = false;
};

}  // namespace meltbench::log
