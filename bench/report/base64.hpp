#pragma once
/// Numbers as text for inside the page.

#include <cstddef>
#include <span>
#include <string>

namespace meltbench::report {

/// RFC 4648 base64 with padding, as atob() reads it.
[[nodiscard]] std::string to_base64(std::span<const std::byte> bytes);

}  // namespace meltbench::report
