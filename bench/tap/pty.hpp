#pragma once

#include <string>

#include "protocols/link/unique_fd.hpp"

namespace meltbench::tap {

/// Our end of a new pseudo-terminal, and a link to the other end at a path that others know beforehand.
class Pty {
 public:
  /// @param path  of the link; one that points to a pseudo-terminal is replaced.
  /// @throws link::LinkError if there is no pseudo-terminal, or something else at that path.
  explicit Pty(std::string path);
  ~Pty();
  Pty(const Pty&) = delete;
  Pty& operator=(const Pty&) = delete;

  [[nodiscard]] const std::string& path() const { return path_; }
  /// Whether a program has the other end open.
  [[nodiscard]] bool has_user() const;
  /// A descriptor of our end, non-blocking. read(2) fails with EIO while no program has the other end open.
  [[nodiscard]] link::UniqueFd duplicate() const;

 private:
  std::string path_;
  link::UniqueFd master_;
};

}  // namespace meltbench::tap
