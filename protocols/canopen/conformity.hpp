#pragma once
/// Rules of a conformance test that can be checked on a dictionary alone.

#include <string>
#include <vector>

#include "protocols/canopen/object_dictionary.hpp"

namespace meltbench::canopen {

/// What a CiA conformance test would object to, one sentence each; empty = nothing. Checks: mandatory objects with
/// their types and access; sub 0 of arrays and records equal to the highest sub-index (but 0x1003, and PDO mappings,
/// where it is the number in use); defaults within limits, limits in order; PDO parameters that come with their
/// mapping; mapped objects that exist, are mappable in that direction, and fit into 8 bytes.
[[nodiscard]] std::vector<std::string> find_conformity_faults(ObjectDictionary& dictionary);

}  // namespace meltbench::canopen
