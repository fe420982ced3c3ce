#include "bench/log/candump_writer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>

#include "protocols/can/candump.hpp"

namespace meltbench::log {
namespace {

constexpr std::size_t kBlock = 64 * 1024;

/// Vector's channels count from 1, Linux interfaces from 0.
std::string to_interface(std::string_view channel) {
  unsigned number = 0;
  const auto end = channel.data() + channel.size();
  const auto [stop, error] = std::from_chars(channel.data(), end, number);
  if (error != std::errc{} || stop != end || number == 0) return std::string{channel};
  return fmt::format("can{}", number - 1);
}

}  // namespace

void CandumpWriter::write(const LogEntry& entry, std::string_view channel) {
  can::append_log_line(text_, std::max(entry.at, Instant{}), to_interface(channel), entry.frame);
  if (text_.size() < kBlock) return;
  sink_->write(text_);
  text_.clear();
}

void CandumpWriter::finish() {
  sink_->write(text_);
  text_.clear();
  sink_->close();
}

}  // namespace meltbench::log
