#pragma once
/// Fewer faults that fail the same way: delta debugging.

#include <functional>
#include <string>
#include <vector>

#include "protocols/config/value.hpp"

namespace meltbench::cli {

struct Minimised {
  std::vector<config::Table> faults;
  std::vector<config::Table> dropped;
  std::vector<config::Table> shortened;  ///< As they were.
  std::size_t runs = 0;
};

/// Takes parts of the faults away as long as what is left still fails, half of them first, then smaller parts: no
/// single fault of the result can be left out (ddmin of Zeller and Hildebrandt, IEEE Trans. Software Eng. 28 (2002)
/// 183-200). Then every fault with for_s lasts half as long, again and again, as long as it still fails, at most
/// kShorter times.
/// @param still_fails  runs the faults. @pre it holds for all of `faults`.
[[nodiscard]] Minimised minimise(std::vector<config::Table> faults,
                                 const std::function<bool(const std::vector<config::Table>&)>& still_fails);

}  // namespace meltbench::cli
