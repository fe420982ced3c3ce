#include "bench/log/log_writer.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>
#include <zlib.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "bench/log/asc_writer.hpp"
#include "bench/log/blf_writer.hpp"
#include "bench/log/candump_writer.hpp"
#include "bench/log/log_error.hpp"
#include "protocols/link/unique_fd.hpp"
#include "protocols/link/write_all.hpp"

namespace meltbench::log {
namespace {

[[noreturn]] void fail(const std::string& name) {
  throw LogError{fmt::format("{}: cannot be written: {}", name, std::strerror(errno)),
                 "is there room on the disk, and may you write there?"};
}

link::UniqueFd open_to_write(const std::filesystem::path& path) {
  link::UniqueFd fd{path == "-" ? ::dup(STDOUT_FILENO)
                                : ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644)};
  if (!fd) fail(path.string());
  return fd;
}

class PlainFile final : public ByteSink {
 public:
  explicit PlainFile(const std::filesystem::path& path)
      : name_{path.string()}, fd_{open_to_write(path)}, seekable_{::lseek(fd_.get(), 0, SEEK_CUR) >= 0} {}

  void write(std::string_view bytes) override {
    if (!link::write_all(fd_.get(), bytes)) fail(name_);
  }
  void rewrite_head(std::string_view bytes) override {
    if (::pwrite(fd_.get(), bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) fail(name_);
  }
  [[nodiscard]] bool can_rewrite() const override { return seekable_; }
  void close() override {
    if (::close(fd_.release()) != 0) fail(name_);
  }

 private:
  std::string name_;
  link::UniqueFd fd_;
  bool seekable_;
};

class PackedFile final : public ByteSink {
 public:
  explicit PackedFile(const std::filesystem::path& path)
      : name_{path.string()}, file_{::gzdopen(open_to_write(path).release(), "wb")} {}
  ~PackedFile() override {
    if (file_ != nullptr) static_cast<void>(::gzclose_w(file_));
  }
  PackedFile(const PackedFile&) = delete;
  PackedFile& operator=(const PackedFile&) = delete;

  void write(std::string_view bytes) override {
    if (bytes.empty()) return;
    if (::gzwrite(file_, bytes.data(), static_cast<unsigned>(bytes.size())) == 0) fail(name_);
  }
  void rewrite_head(std::string_view) override {}
  [[nodiscard]] bool can_rewrite() const override { return false; }
  void close() override {
    if (::gzclose_w(std::exchange(file_, nullptr)) != Z_OK) fail(name_);
  }

 private:
  std::string name_;
  gzFile file_;
};

std::filesystem::path without_gz(std::filesystem::path path) {
  return path.extension() == ".gz" ? path.replace_extension() : path;
}

}  // namespace

std::unique_ptr<ByteSink> create_file(const std::filesystem::path& path) {
  if (path.extension() == ".gz") return std::make_unique<PackedFile>(path);
  return std::make_unique<PlainFile>(path);
}

LogFormat format_by_name(const std::filesystem::path& path) {
  const std::string extension = without_gz(path).extension().string();
  if (extension == ".asc") return LogFormat::kAsc;
  if (extension == ".blf" && path.extension() != ".gz") return LogFormat::kBlf;
  if (extension == ".log" || extension == ".txt" || extension.empty()) return LogFormat::kCandump;
  if (extension == ".blf") {
    throw LogError{fmt::format("{}: a BLF file gets its head last, so it must be a plain file", path.string()),
                   "leave .gz away: it is packed inside already"};
  }
  throw LogError{fmt::format("{}: no log ends in {}", path.string(), extension),
                 "NAME.log or .txt is candump text, NAME.asc and NAME.blf are Vector's; .gz behind it packs the texts"};
}

std::unique_ptr<LogWriter> create_log(std::unique_ptr<ByteSink> sink, LogFormat format) {
  switch (format) {
    case LogFormat::kAsc:
      return std::make_unique<AscWriter>(std::move(sink));
    case LogFormat::kBlf:
      if (!sink->can_rewrite()) {
        throw LogError{"a BLF file gets its head last, so it must be a plain file", "write it to a file of its own"};
      }
      return std::make_unique<BlfWriter>(std::move(sink));
    case LogFormat::kCandump:
      break;
  }
  return std::make_unique<CandumpWriter>(std::move(sink));
}

}  // namespace meltbench::log
