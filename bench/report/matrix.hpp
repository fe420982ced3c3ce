#pragma once
/// One page over a suite: what was tried on what, and whether the reaction came.

#include <filesystem>
#include <span>
#include <string>

namespace meltbench::report {

/// One run of a suite.
struct MatrixCell {
  std::string row;               ///< What it was tried on: "board.feeder".
  std::string column;            ///< What was tried: "off".
  std::string name;              ///< Of the run.
  std::string note;              ///< The smallest margin, or what failed.
  std::filesystem::path report;  ///< Relative to the page.
  bool held = false;
};

/// Writes a self-contained page: rows and columns in the order in which they first come, each cell linked to the pages
/// of its runs.
/// @throws std::system_error if the file cannot be written.
void write_matrix(const std::filesystem::path& page, std::string_view title, std::span<const MatrixCell> cells);

}  // namespace meltbench::report
