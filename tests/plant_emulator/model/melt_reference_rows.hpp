#pragma once
/// Reads fixtures/reference/melt_doublet.csv for tests.

#include <fstream>
#include <sstream>
#include <string>
#include <vector>

namespace meltbench {

struct DoubletRow {
  std::string preset;
  double speed_m_per_s;
  int t_over_T1;
  double shift_m;
};

inline std::vector<DoubletRow> read_doublet_rows() {
  std::ifstream file{std::string{MELTBENCH_SOURCE_DIR} + "/fixtures/reference/melt_doublet.csv"};
  std::vector<DoubletRow> rows;
  for (std::string line; std::getline(file, line);) {
    if (line.empty() || line[0] == '#' || line.rfind("preset", 0) == 0) continue;
    std::istringstream fields{line};
    DoubletRow row;
    char comma = 0;
    std::getline(fields, row.preset, ',');
    fields >> row.speed_m_per_s >> comma >> row.t_over_T1 >> comma >> row.shift_m;
    rows.push_back(row);
  }
  return rows;
}

}  // namespace meltbench
