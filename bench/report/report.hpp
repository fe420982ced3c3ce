#pragma once
/// report.html: one self-contained page about one or more runs, verdict first, plots that zoom together.

#include <filesystem>
#include <span>
#include <stdexcept>
#include <string>

#include "bench/check/check.hpp"
#include "bench/record/recording.hpp"

namespace meltbench::report {

/// A judged run. Borrowed: both must outlive the call.
struct Run {
  const record::Recording* recording = nullptr;
  const check::CheckResults* results = nullptr;
};

/// The page cannot be made, e.g. dygraphs is not installed. hint() says what to do.
class ReportError : public std::runtime_error {
 public:
  ReportError(const std::string& message, std::string hint) : std::runtime_error{message}, hint_{std::move(hint)} {}
  [[nodiscard]] const std::string& hint() const { return hint_; }

 private:
  std::string hint_;
};

/// The page as text. Several runs: their signals are overlaid, one colour per run.
/// Needs no network and no other file: dygraphs is copied in from MELTBENCH_DYGRAPHS_DIR (set when building, Debian's
/// /usr/share/javascript/dygraphs by default). Long runs are thinned to the minimum and maximum per pixel-sized bucket,
/// so that the page stays below about 3 MB.
/// @pre at least one run.  @throws ReportError if dygraphs cannot be read.
[[nodiscard]] std::string render_report(std::span<const Run> runs);

/// Writes render_report() to `path`, whole or not at all.
/// @throws ReportError; std::system_error naming the path.
void write_report(const std::filesystem::path& path, std::span<const Run> runs);

}  // namespace meltbench::report
