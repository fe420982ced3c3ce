#pragma once

#include <string>

#include "protocols/link/unique_fd.hpp"

namespace meltbench::link {

/// A new pseudo-terminal: our end of it, and a name that others know beforehand for the other end.
class PseudoTerminal {
 public:
  /// @param name  of the link to the other end; a link that leads to a pseudo-terminal is replaced, nothing else is.
  /// @throws LinkError if there is no pseudo-terminal, or no link to be made.
  explicit PseudoTerminal(std::string name);
  /// Takes the link away, if it still is ours.
  ~PseudoTerminal();
  PseudoTerminal(const PseudoTerminal&) = delete;
  PseudoTerminal& operator=(const PseudoTerminal&) = delete;

  [[nodiscard]] const std::string& name() const { return name_; }
  /// Our end, non-blocking. read(2) fails with EIO while nobody has the other end open.
  [[nodiscard]] int fd() const { return near_end_.get(); }
  /// Whether the other end is open, by a program or by hold_far_end().
  [[nodiscard]] bool has_user() const;
  /// Keeps the other end open, so that ours does not hang up when whoever uses it goes.
  /// @throws LinkError
  void hold_far_end();

 private:
  std::string name_;
  std::string device_;  ///< The other end's: /dev/pts/N.
  UniqueFd near_end_;
  UniqueFd far_end_;  ///< Where it is held.
};

/// Makes a terminal pass bytes as they are: no echo, no line editing, no signals. @returns false, with errno: it
/// cannot.
[[nodiscard]] bool make_raw(int fd) noexcept;

}  // namespace meltbench::link
