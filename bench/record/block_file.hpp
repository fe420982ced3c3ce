#pragma once
/// A text file written in large blocks that end at line ends.

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>

#include "protocols/link/unique_fd.hpp"

namespace meltbench::record {

/// Collects whole lines and hands them to the kernel 64 KiB at a time. Not thread-safe.
///
/// A caller appends one line (with its '\n') to text(), then calls end_line(). After a failed write it drops everything
/// and keeps the reason: the loop that records must not stop for a full disk, which leaves the last whole block.
class BlockFile {
 public:
  /// Creates or empties the file. @throws std::system_error naming the path.
  explicit BlockFile(const std::filesystem::path& path);
  ~BlockFile();
  BlockFile(const BlockFile&) = delete;
  BlockFile& operator=(const BlockFile&) = delete;

  [[nodiscard]] std::string& text() { return text_; }
  void end_line() {
    if (text_.size() >= kBlock) flush();
  }
  void flush() noexcept;

  /// "path: No space left on device"; empty while all is well.
  [[nodiscard]] const std::string& error() const { return error_; }

 private:
  static constexpr std::size_t kBlock = std::size_t{64} * 1024;
  std::string path_;
  std::string text_;
  std::string error_;
  link::UniqueFd fd_;
  std::uint64_t written_ = 0;
};

}  // namespace meltbench::record
