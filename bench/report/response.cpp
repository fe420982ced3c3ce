#include "bench/report/response.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "bench/record/reaction_times.hpp"
#include "bench/report/escape.hpp"
#include "bench/report/sections.hpp"

namespace meltbench::report {
namespace {

constexpr std::size_t kBucketsPerBin = LogHistogram::kPerOctave / 4;

std::optional<double> find_last(const record::Recording& recording, const std::string& signal) {
  const auto column = recording.find_signal(signal);
  if (!column || recording.row_count() == 0) return std::nullopt;
  return recording.value(recording.row_count() - 1, *column);
}

std::string time_text(Nanos span) {
  return format_quantity(to_s(span), "s");
}

std::string render_row(const Response& response, std::size_t run, const std::string& run_name) {
  const LogHistogram& times = response.times;
  return fmt::format(
      "<tr><td>{}</td><td><span class=\"swatch run{}\"></span>{}</td><td class=\"number\">{}</td>"
      "<td class=\"number\">{}</td><td class=\"number\">{}</td><td class=\"number\">{}</td><td class=\"number\">{}</td>"
      "<td class=\"number\"><button class=\"at\" data-t=\"{:.9g}\">{:.3f} s</button></td>"
      "<td class=\"number\">{}</td></tr>\n",
      escape_markup(response.name), run % 8, escape_markup(run_name), times.count(), time_text(times.quantile(0.5)),
      time_text(times.quantile(0.99)), time_text(times.quantile(0.999)), time_text(times.max()), to_s(times.max_at()),
      to_s(times.max_at()), response.overruns ? fmt::format("{:.0f}", *response.overruns) : "–");
}

std::string render_figure(const std::string& name, const Histogram& histogram) {
  return fmt::format(
      "<figure><figcaption><b>{}</b><small>both axes logarithmic</small></figcaption>{}"
      "<div class=\"ends\"><span>{}</span><span>{}</span></div></figure>\n",
      escape_markup(name), render_histogram(histogram), format_quantity(histogram.from_s, "s"),
      format_quantity(histogram.to_s, "s"));
}

}  // namespace

std::vector<Response> collect_responses(const record::Recording& recording) {
  std::vector<Response> responses;
  LogHistogram reactions = record::calc_reaction_times(recording.frames);
  if (reactions.count() > 0) responses.push_back({"SYNC to command", reactions, std::nullopt});
  for (const record::WakeupTiming& timing : recording.ending.wakeups) {
    if (timing.lateness.count() == 0) continue;
    responses.push_back({timing.participant + " wakes up late by", timing.lateness,
                         find_last(recording, timing.participant + ".deadline_misses")});
  }
  return responses;
}

std::optional<Histogram> calc_log_histogram(std::span<const LogHistogram* const> runs) {
  std::size_t first = LogHistogram::kBuckets;
  std::size_t last = 0;
  for (const LogHistogram* run : runs) {
    for (std::size_t bucket = 0; bucket < LogHistogram::kBuckets; ++bucket) {
      if (run->in_bucket(bucket) == 0) continue;
      first = std::min(first, bucket / kBucketsPerBin);
      last = std::max(last, bucket / kBucketsPerBin);
    }
  }
  if (first > last) return std::nullopt;
  Histogram histogram{to_s(LogHistogram::lower_edge(first * kBucketsPerBin)),
                      to_s(LogHistogram::lower_edge((last + 1) * kBucketsPerBin)),
                      {}};
  for (const LogHistogram* run : runs) {
    std::vector<std::size_t>& counts = histogram.counts.emplace_back(last - first + 1, 0);
    for (std::size_t bucket = first * kBucketsPerBin; bucket < (last + 1) * kBucketsPerBin; ++bucket) {
      counts[bucket / kBucketsPerBin - first] += static_cast<std::size_t>(run->in_bucket(bucket));
    }
  }
  return histogram;
}

std::string render_responses(std::span<const Run> runs) {
  const std::vector<std::string> run_names = name_runs(runs);
  std::vector<std::vector<Response>> of_run;
  std::vector<std::string> names;
  for (const Run& run : runs) {
    for (const Response& response : of_run.emplace_back(collect_responses(*run.recording))) {
      if (std::find(names.begin(), names.end(), response.name) == names.end()) names.push_back(response.name);
    }
  }
  if (names.empty()) return {};
  std::string rows;
  std::string figures;
  for (const std::string& name : names) {
    const LogHistogram none;
    std::vector<const LogHistogram*> times;
    for (std::size_t run = 0; run < runs.size(); ++run) {
      const auto found = std::find_if(of_run[run].begin(), of_run[run].end(),
                                      [&](const Response& response) { return response.name == name; });
      times.push_back(found == of_run[run].end() ? &none : &found->times);
      if (found != of_run[run].end()) rows += render_row(*found, run, run_names[run]);
    }
    if (const auto histogram = calc_log_histogram(times)) figures += render_figure(name, *histogram);
  }
  return fmt::format(
      "<h2>Reactions and wake-ups</h2>\n<p class=\"muted\">On the wire, from a SYNC to the first PDO that commands a "
      "board; at wall-clock pace also how late each program was woken at its deadlines. A wake-up more than one row of "
      "the recording late is a missed deadline.</p>\n<div class=\"scroll\"><table><thead><tr><th>what</th><th>run</th>"
      "<th class=\"number\">count</th><th class=\"number\">p50</th><th class=\"number\">p99</th>"
      "<th class=\"number\">p99.9</th><th class=\"number\">max</th><th class=\"number\">at</th>"
      "<th class=\"number\">missed</th></tr></thead><tbody>\n{}</tbody></table></div>\n<div class=\"histograms\">\n{}"
      "</div>\n",
      rows, figures);
}

}  // namespace meltbench::report
