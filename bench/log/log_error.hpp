#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>

namespace meltbench::log {

/// A log that cannot be read or written. what() is "<file>[:<line>[:<column>]]: <why>", hint() says what to do.
class LogError : public std::runtime_error {
 public:
  LogError(const std::string& what, std::string hint) : std::runtime_error{what}, hint_{std::move(hint)} {}
  [[nodiscard]] const std::string& hint() const { return hint_; }

 private:
  std::string hint_;
};

}  // namespace meltbench::log
