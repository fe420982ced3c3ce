#pragma once

#include <optional>
#include <vector>

#include "bench/log/blf_format.hpp"
#include "bench/log/log_reader.hpp"

namespace meltbench::log {

/// Vector's binary log: containers, packed with zlib or not, with objects in them that may go on in the next container.
/// CAN frames of all kinds are read, other objects passed over. A file that is cut off is read as far as it goes.
/// Instants are the file's start, read as UTC, plus the stamp; a start before 1990 counts as zero.
class BlfReader final : public LogReader {
 public:
  /// @throws LogError if the file's header is not one.
  explicit BlfReader(std::unique_ptr<ByteSource> source);
  [[nodiscard]] std::uint64_t line() const override { return objects_; }

 private:
  [[nodiscard]] bool read(LogEntry& entry) override;
  [[nodiscard]] std::size_t take_file_bytes(void* to, std::size_t count);
  [[nodiscard]] bool skip_file_bytes(std::size_t count);
  [[nodiscard]] bool load_container();
  void unpack(std::uint16_t packing, std::size_t unpacked_size);
  [[nodiscard]] bool read_object(std::span<const char> object, LogEntry& entry);
  [[nodiscard]] bool read_frame(std::uint32_t type, std::span<const char> body, LogEntry& entry);
  void set_frame(LogEntry& entry, unsigned channel, std::uint32_t id, bool sent);
  [[noreturn]] void refuse(std::string_view why) const;

  static constexpr std::size_t kMaxObject = 1U << 20U;  // Containers have 128 KiB, no object is larger.
  Instant start_{};
  std::vector<char> packed_;
  std::vector<char> plain_;  ///< Unpacked,
  std::size_t next_ = 0;     ///< and what of it has been read.
  std::uint64_t objects_ = 0;
  std::uint64_t file_size_ = 0;  ///< As the header tells; 0 of a file whose writer was cut off.
  std::uint64_t taken_ = 0;      ///< Of the file.
};

}  // namespace meltbench::log
