#include "bench/log/byte_source.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

#include "bench/log/log_error.hpp"

namespace meltbench::log {
namespace {

/// Through zlib, which hands on as it is what is not compressed.
class FileSource final : public ByteSource {
 public:
  explicit FileSource(const std::filesystem::path& path) : name_{path == "-" ? "standard input" : path.string()} {
    if (std::filesystem::is_directory(path)) {
      throw LogError{fmt::format("{}: is a folder", name_), "name the log itself, e.g. bus.log in a run's folder"};
    }
    const int fd = path == "-" ? ::dup(STDIN_FILENO) : ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    if (fd < 0) throw LogError{fmt::format("{}: {}", name_, std::strerror(errno)), "is the path right?"};
    file_ = ::gzdopen(fd, "rb");
    static_cast<void>(::gzbuffer(file_, kUnpackBuffer));
  }
  ~FileSource() override { static_cast<void>(::gzclose_r(file_)); }
  FileSource(const FileSource&) = delete;
  FileSource& operator=(const FileSource&) = delete;

  [[nodiscard]] std::size_t read(std::span<char> buffer) override {
    const int count = ::gzread(file_, buffer.data(), static_cast<unsigned>(buffer.size()));
    int status = Z_OK;
    const char* why = ::gzerror(file_, &status);
    cut_off_ = status == Z_BUF_ERROR;  // Read as far as it goes.
    if (count < 0 || (status != Z_OK && status != Z_BUF_ERROR)) {
      std::string_view reason = status == Z_ERRNO ? std::strerror(errno) : why;
      const std::size_t colon = reason.rfind(": ");  // zlib begins with a name of its own for the file.
      if (colon != std::string_view::npos) reason.remove_prefix(colon + 2);
      throw LogError{fmt::format("{}: cannot be read: {}", name_, reason), "is the file damaged? try gzip -t on it"};
    }
    return static_cast<std::size_t>(count);
  }
  [[nodiscard]] bool is_cut_off() const override { return cut_off_; }
  [[nodiscard]] const std::string& name() const override { return name_; }

 private:
  static constexpr unsigned kUnpackBuffer = 128 * 1024;
  std::string name_;
  gzFile file_ = nullptr;
  bool cut_off_ = false;
};

}  // namespace

std::unique_ptr<ByteSource> open_file(const std::filesystem::path& path) {
  return std::make_unique<FileSource>(path);
}

std::size_t MemorySource::read(std::span<char> buffer) {
  const std::size_t count = std::min(buffer.size(), rest_.size());
  std::copy_n(rest_.begin(), count, buffer.begin());
  rest_ = rest_.subspan(count);
  return count;
}

PeekedSource::PeekedSource(std::unique_ptr<ByteSource> source) : source_{std::move(source)} {
  std::array<char, kHeadSize> bytes{};
  while (head_.size() < kHeadSize) {
    const std::size_t count = source_->read(std::span{bytes}.first(kHeadSize - head_.size()));
    if (count == 0) break;
    head_.append(bytes.data(), count);
  }
}

std::size_t PeekedSource::read(std::span<char> buffer) {
  const std::size_t count = std::min(buffer.size(), head_.size() - given_);
  std::copy_n(head_.begin() + static_cast<std::ptrdiff_t>(given_), count, buffer.begin());
  given_ += count;
  return count > 0 ? count : source_->read(buffer);
}

}  // namespace meltbench::log
