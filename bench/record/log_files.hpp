#pragma once
/// The files of a long recording: whole lines, also after kill -9, and a new file by size or time.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "protocols/link/unique_fd.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::record {

struct LogFilesRequest {
  std::filesystem::path file;             ///< The first; the next are "NAME.2.log", "NAME.3.log" ...
  std::string head;                       ///< Whole lines that every file begins with; may be empty.
  std::optional<std::uint64_t> max_size;  ///< Bytes; a new file before one grows beyond it.
  std::optional<Nanos> max_age;           ///< A new file when the first line of one is so old.
};

/// Takes whole lines and writes them in blocks, each with one write(2). Not thread-safe.
///
/// A process that is killed in a write leaves what had been copied, and the kernel copies memory page by page. So no
/// line lies across a page of the file: what is left of a page is filled with a line of blanks, which every reader of
/// candump text passes over. A disk that is full leaves the last whole block.
class LogFiles {
 public:
  /// Creates the first file. @throws std::system_error naming it: it cannot be written, or is there already.
  explicit LogFiles(LogFilesRequest request);

  /// Adds a line that ends in '\n', and is shorter than a page. `at` decides about a new file only.
  /// @throws std::system_error naming the file if a block cannot be written.
  void append(Instant at, std::string_view line);
  /// All lines are the kernel's. @throws as append()
  void flush();

  [[nodiscard]] std::size_t files() const { return number_; }
  [[nodiscard]] const std::filesystem::path& file() const { return file_; }  ///< That is written now.

 private:
  void open_next();
  void put(std::string_view line);

  static constexpr std::size_t kPage = 4096;
  static constexpr std::size_t kBlock = 16 * kPage;
  LogFilesRequest request_;
  std::filesystem::path file_;
  link::UniqueFd fd_;
  std::size_t number_ = 0;
  std::uint64_t written_ = 0;  ///< Of this file; text_ comes on top.
  std::string text_;
  std::optional<Instant> first_at_;  ///< Of this file.
};

}  // namespace meltbench::record
