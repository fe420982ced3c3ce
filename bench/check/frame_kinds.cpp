#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "bench/check/kinds.hpp"
#include "bench/check/series.hpp"
#include "protocols/can/frame_length.hpp"

namespace meltbench::check {
namespace {

struct Gap {
  Instant end;  ///< When the frame came that closed it, or the window ended.
  double length_s = 0;
};

/// Gaps between the frames of an identifier in the window.
struct Gaps {
  std::vector<Gap> closed;
  std::optional<Gap> silence;  ///< From the last frame to the end of the window or of the run.
  std::size_t frames = 0;
};

Gaps find_gaps(const record::Recording& recording, std::uint32_t cob_id, const Window& window) {
  Gaps gaps;
  std::optional<Instant> previous;
  for (std::size_t i = 0; i < recording.frames.size(); ++i) {
    const Instant at = recording.frames.at(i);
    if (at < window.from || at > window.to || !recording.frames.is_standard_data(i, cob_id)) continue;
    ++gaps.frames;
    if (previous) gaps.closed.push_back({at, to_s(at - *previous)});
    previous = at;
  }
  const Instant end = std::min(window.to, recording.ending.at);
  if (previous && end > *previous) gaps.silence = Gap{end, to_s(end - *previous)};
  return gaps;
}

/// Position of the percentile in n sorted values, nearest rank. @pre n > 0, 0 < percentile <= 100.
std::size_t rank_of(double percentile, std::size_t n) {
  const double rank = std::ceil(percentile / 100.0 * static_cast<double>(n));
  return std::min(n, static_cast<std::size_t>(std::max(1.0, rank))) - 1;
}

std::string share_text(double percentile) {
  return percentile < 100 ? fmt::format(" ({:.6g} % of them)", percentile) : std::string{};
}

}  // namespace

Outcome FramePeriod::judge(const record::Recording& recording) const {
  Outcome outcome;
  outcome.unit = "s";
  Gaps gaps = find_gaps(recording, cob_id, window);
  if (gaps.frames == 0) return failed(std::move(outcome), fmt::format("no frame {:03X} in the window", cob_id));
  const double period_s = to_s(period);
  // The rest of the window is shorter than a period as a rule, and says something only when it is longer.
  if (gaps.silence && (gaps.silence->length_s > period_s || gaps.closed.empty())) gaps.closed.push_back(*gaps.silence);
  if (gaps.closed.empty())
    return failed(std::move(outcome), fmt::format("only one frame {:03X} in the window", cob_id));

  const auto deviation = [&](const Gap& gap) { return std::abs(gap.length_s - period_s); };
  // Of equal ones the first is told: it is the one that lies last.
  std::sort(gaps.closed.begin(), gaps.closed.end(), [&](const Gap& a, const Gap& b) {
    return std::pair{deviation(a), b.end} < std::pair{deviation(b), a.end};
  });
  const Gap& judged_gap = gaps.closed[rank_of(percentile, gaps.closed.size())];
  return judged(std::move(outcome), to_s(max_deviation) - deviation(judged_gap), to_s(judged_gap.end),
                fmt::format("{} frames {:03X}, period off by up to {:.6g} ms{} from {:.6g} ms; asked for: {:.6g} ms",
                            gaps.frames, cob_id, 1e3 * deviation(judged_gap), share_text(percentile), 1e3 * period_s,
                            1e3 * to_s(max_deviation)));
}

Outcome FrameJitter::judge(const record::Recording& recording) const {
  Outcome outcome;
  outcome.unit = "s";
  Gaps gaps = find_gaps(recording, cob_id, window);
  std::vector<Gap>& closed = gaps.closed;
  if (closed.empty())
    return failed(std::move(outcome), fmt::format("fewer than two frames {:03X} in the window", cob_id));
  std::sort(closed.begin(), closed.end(), [](const Gap& a, const Gap& b) {
    return std::pair{a.length_s, b.end} < std::pair{b.length_s, a.end};
  });
  const std::size_t high = rank_of(percentile, closed.size());
  const std::size_t low = std::min(high, closed.size() - 1 - high);
  const double jitter_s = closed[high].length_s - closed[low].length_s;
  return judged(std::move(outcome), to_s(max) - jitter_s, to_s(closed[high].end),
                fmt::format("{} frames {:03X}, period from {:.6g} to {:.6g} ms{}; asked for: at most {:.6g} ms apart",
                            gaps.frames, cob_id, 1e3 * closed[low].length_s, 1e3 * closed[high].length_s,
                            share_text(percentile), 1e3 * to_s(max)));
}

Outcome BusLoad::judge(const record::Recording& recording) const {
  Outcome outcome;
  outcome.unit = "share";
  if (!recording.info.bit_rate_bit_per_s) return failed(std::move(outcome), "the bit rate of this bus is not known");
  const Nanos bit_time{1'000'000'000 / *recording.info.bit_rate_bit_per_s};
  const record::FrameLog& frames = recording.frames;
  const Nanos space = can::kIntermissionBits * bit_time;
  const auto time_of = [&](std::size_t i) {
    const can::FrameLength length = can::calc_frame_length(frames[i].frame);
    return (length.nominal_bits + length.data_bits) * bit_time + space;
  };
  const auto counts = [&](std::size_t i) {
    return frames.at(i) >= window.from && frames.at(i) <= window.to && !frames.is_error(i);
  };
  Nanos busy{};
  Nanos most{};
  Instant most_at = window.from;
  std::size_t oldest = 0;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (!counts(i)) continue;
    busy += time_of(i);
    for (; frames.at(i) - frames.at(oldest) >= over; ++oldest) {
      if (counts(oldest)) busy -= time_of(oldest);
    }
    // The stretch ends with this frame: its interframe space is outside, and so is what began before the stretch.
    const Nanos before =
        counts(oldest) ? time_of(oldest) - space - (frames.at(oldest) - (frames.at(i) - over)) : Nanos{};
    const Nanos inside = busy - space - std::max(before, Nanos{});
    if (inside > most) {
      most = inside;
      most_at = frames.at(i);
    }
  }
  const double load = to_s(most) / to_s(over);
  return judged(std::move(outcome), max - load, to_s(most_at),
                fmt::format("busiest {:.6g} ms: {:.2f} % of the time; asked for: at most {:.6g} %", 1e3 * to_s(over),
                            100 * load, 100 * max));
}

}  // namespace meltbench::check
