#include "bench/log/log_reader.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "bench/log/asc_reader.hpp"
#include "bench/log/blf_reader.hpp"
#include "bench/log/candump_reader.hpp"
#include "bench/log/words.hpp"

namespace meltbench::log {

namespace {

/// What a log says of itself in its first bytes.
LogFormat format_of(std::string_view head) {
  if (head.starts_with("LOGG")) return LogFormat::kBlf;
  while (!head.empty() && static_cast<unsigned char>(head.front()) <= ' ') head.remove_prefix(1);
  const auto starts_with = [head](std::string_view word) {
    return head.size() >= word.size() && std::ranges::equal(head.substr(0, word.size()), word, {}, to_lower);
  };
  return starts_with("date ") || starts_with("base ") || starts_with("//") ? LogFormat::kAsc : LogFormat::kCandump;
}

}  // namespace

bool LogReader::next(LogEntry& entry) {
  if (!read(entry)) {
    if (!ended_ && source_->is_cut_off()) warn("the packed file is cut off: what comes behind is lost");
    ended_ = true;
    return false;
  }
  ++frames_;
  if (entry.at < latest_) {
    warn(fmt::format("time goes back by {:.6f} s", to_s(latest_ - entry.at)));
  }
  latest_ = entry.at;
  return true;
}

std::size_t LogReader::channel_number(std::string_view name) {
  if (last_channel_ < channels_.size() && channels_[last_channel_] == name) return last_channel_;
  const auto found = std::ranges::find(channels_, name);
  last_channel_ = static_cast<std::size_t>(found - channels_.begin());
  if (found == channels_.end()) channels_.emplace_back(name);
  return last_channel_;
}

void LogReader::warn(std::string text) {
  ++warning_count_;
  if (warnings_.size() < kKeptWarnings) warnings_.push_back({line(), std::move(text)});
}

std::unique_ptr<LogReader> open_log(std::unique_ptr<ByteSource> source) {
  auto peeked = std::make_unique<PeekedSource>(std::move(source));
  peeked->pass_over("\xEF\xBB\xBF");  // What editors of another system put before UTF-8.
  const LogFormat format = format_of(peeked->head());
  switch (format) {
    case LogFormat::kBlf:
      return std::make_unique<BlfReader>(std::move(peeked));
    case LogFormat::kAsc:
      return std::make_unique<AscReader>(std::move(peeked));
    case LogFormat::kCandump:
      break;
  }
  return std::make_unique<CandumpReader>(std::move(peeked));
}

std::unique_ptr<LogReader> open_log(const std::filesystem::path& path) {
  return open_log(open_file(path));
}

}  // namespace meltbench::log
