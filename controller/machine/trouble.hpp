#pragma once
/// Why the controller lets go of the machine.

#include <string>
#include <string_view>

namespace meltbench::machine {

struct Trouble {
  std::string_view code;  ///< Stable, in kebab case; of a text that lives for ever.
  std::string text;       ///< For people: what, how far from what it should be, what to look at.
};

}  // namespace meltbench::machine
