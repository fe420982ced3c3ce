#pragma once
/// Where the bytes of a log come from: a file, plain or compressed, or memory.

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>

namespace meltbench::log {

class ByteSource {
 public:
  virtual ~ByteSource() = default;
  /// Fills the buffer as far as there is something. @returns the count; 0 at the end.
  /// @throws LogError if the file cannot be read or its compression is broken.
  [[nodiscard]] virtual std::size_t read(std::span<char> buffer) = 0;
  /// Whether the end that read() has found is not the end of what was packed.
  [[nodiscard]] virtual bool is_cut_off() const { return false; }
  /// For complaints: the path.
  [[nodiscard]] virtual const std::string& name() const = 0;
};

/// A file, or standard input for "-"; what is compressed with gzip is unpacked on the way.
/// @throws LogError if it cannot be opened.
[[nodiscard]] std::unique_ptr<ByteSource> open_file(const std::filesystem::path& path);

/// Bytes that lie in memory and outlive the source.
class MemorySource final : public ByteSource {
 public:
  explicit MemorySource(std::span<const char> bytes, std::string name = "memory")
      : rest_{bytes}, name_{std::move(name)} {}
  [[nodiscard]] std::size_t read(std::span<char> buffer) override;
  [[nodiscard]] const std::string& name() const override { return name_; }

 private:
  std::span<const char> rest_;
  std::string name_;
};

/// Another source, whose first bytes can be looked at before they are read.
class PeekedSource final : public ByteSource {
 public:
  static constexpr std::size_t kHeadSize = 64;
  explicit PeekedSource(std::unique_ptr<ByteSource> source);
  /// The first kHeadSize bytes, fewer if there are no more.
  [[nodiscard]] std::string_view head() const { return std::string_view{head_}.substr(given_); }
  /// Leaves out what the source begins with, if it does.
  void pass_over(std::string_view mark) {
    if (head().starts_with(mark)) given_ += mark.size();
  }
  [[nodiscard]] std::size_t read(std::span<char> buffer) override;
  [[nodiscard]] bool is_cut_off() const override { return source_->is_cut_off(); }
  [[nodiscard]] const std::string& name() const override { return source_->name(); }

 private:
  std::unique_ptr<ByteSource> source_;
  std::string head_;
  std::size_t given_ = 0;  ///< Of the head.
};

}  // namespace meltbench::log
