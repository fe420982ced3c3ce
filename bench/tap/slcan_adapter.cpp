#include "bench/tap/slcan_adapter.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>

#include "protocols/can/slcan.hpp"

namespace meltbench::tap {
namespace {

using can::kSlcanEnd;
using can::kSlcanRefused;

constexpr std::size_t kMaxWaiting = 64;  // As many as a common adapter keeps.
constexpr std::int64_t kStampPeriod_ms = 60'000;
constexpr std::string_view kFrameLetters = "tTrRdDbB";

bool is_frame(std::string_view line) {
  return !line.empty() && kFrameLetters.find(line.front()) != std::string_view::npos;
}

bool is_digit(std::string_view text, char last) {
  return text.size() == 1 && text.front() >= '0' && text.front() <= last;
}

}  // namespace

std::size_t SlcanAdapter::hear(std::string_view said, std::size_t room, std::string& answers,
                               std::vector<can::CanFrame>& sent) {
  const std::size_t full = sent.size() + room;
  std::size_t used = 0;
  while (true) {
    std::string_view line = said.substr(used);
    const std::size_t end = line.find(kSlcanEnd);
    if (end == std::string_view::npos) {
      if (line.size() <= can::SlcanLines::kMaxLine) return used;
      answers += kSlcanRefused;
      return said.size();
    }
    line = line.substr(0, end);
    line.remove_prefix(std::min(line.find_first_not_of('\n'), line.size()));
    if (sent.size() == full && is_frame(line)) return used;
    obey(line, answers, sent);
    used += end + 1;
  }
}

void SlcanAdapter::obey(std::string_view line, std::string& answers, std::vector<can::CanFrame>& sent) {
  if (is_frame(line)) return send(line, answers, sent);
  const char command = line.empty() ? kSlcanEnd : line.front();
  bool accepted = true;
  if (line == "V" || line == "v") {
    answers.append(line).append("1013");
  } else if (line == "N") {
    answers += "NA123";
  } else if (line == "F" && open_) {
    answers += overrun_ ? "F01" : "F00";
    overrun_ = false;
  } else if (line == "P" && open_ && !unasked_) {
    if (!waiting_.empty()) answers += take_waiting();
  } else if (line == "A" && open_ && !unasked_) {
    while (!waiting_.empty()) answers.append(take_waiting()).push_back(kSlcanEnd);
    answers += 'A';
  } else if (!line.empty()) {
    accepted = set_up(command, line.substr(1));
  }
  answers += accepted ? kSlcanEnd : kSlcanRefused;
}

/// Commands that change how the adapter is set. @returns false if it refuses.
bool SlcanAdapter::set_up(char command, std::string_view rest) {
  switch (command) {
    case 'O':
    case 'L':
      if (!rest.empty()) return false;
      open_ = true;
      listen_only_ = command == 'L';
      return true;
    case 'C':
      open_ = false;
      waiting_.clear();
      return rest.empty();
    case 'S':
      return !open_ && is_digit(rest, '9');
    case 's':
      return !open_ && !rest.empty();
    case 'Y':
      return !open_ && is_digit(rest, '8');
    case 'Z':
      stamps_ = rest == "1";
      return is_digit(rest, '1');
    case 'X':
      unasked_ = rest != "0";
      return is_digit(rest, '1');
    case 'M':
      return rest.size() == 8;  // Of no effect: the mask below leaves none of its bits.
    case 'm':
      return rest == "FFFFFFFF" || rest == "ffffffff";
    default:
      return false;
  }
}

void SlcanAdapter::send(std::string_view line, std::string& answers, std::vector<can::CanFrame>& sent) const {
  const auto parsed = can::parse_slcan(line);
  if (!open_ || listen_only_ || read_only_ || !parsed) {
    answers += kSlcanRefused;
    return;
  }
  sent.push_back(parsed->frame);
  if (unasked_) answers += parsed->frame.extended ? 'Z' : 'z';
  answers += kSlcanEnd;
}

/// The oldest frame that waits to be asked for, without its line end. @pre there is one.
std::string SlcanAdapter::take_waiting() {
  std::string line = std::move(waiting_.front());
  waiting_.pop_front();
  return line;
}

void SlcanAdapter::tell(const can::StampedFrame& stamped, std::string& out) {
  std::string line;
  if (!can::append_slcan(line, stamped.frame)) return;
  if (stamps_) {
    line.pop_back();
    const std::int64_t ms = stamped.at.since_start / 1ms % kStampPeriod_ms;
    fmt::format_to(std::back_inserter(line), "{:04X}{}", ms, kSlcanEnd);
  }
  if (unasked_) {
    out += line;
  } else if (waiting_.size() < kMaxWaiting) {
    line.pop_back();
    waiting_.push_back(std::move(line));
  } else {
    overrun_ = true;
  }
}

}  // namespace meltbench::tap
