#include "bench/record/log_files.hpp"

#include <fcntl.h>
#include <fmt/format.h>

#include <cerrno>
#include <system_error>

#include "protocols/link/write_all.hpp"

namespace meltbench::record {
namespace {

[[noreturn]] void throw_errno(const std::filesystem::path& file) {
  throw std::system_error{errno, std::generic_category(), file.string()};
}

}  // namespace

LogFiles::LogFiles(LogFilesRequest request) : request_{std::move(request)} {
  text_.reserve(kBlock + kPage);
  open_next();
}

void LogFiles::open_next() {
  ++number_;
  file_ = request_.file;
  if (number_ > 1) {
    file_.replace_filename(
        fmt::format("{}.{}{}", request_.file.stem().string(), number_, request_.file.extension().string()));
  }
  fd_ = link::UniqueFd{::open(file_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644)};
  if (!fd_) throw_errno(file_);
  written_ = 0;
  first_at_.reset();
  std::string_view rest = request_.head;
  while (!rest.empty()) {
    const std::size_t size = std::min(rest.find('\n'), rest.size() - 1) + 1;
    put(rest.substr(0, size));
    rest.remove_prefix(size);
  }
}

void LogFiles::append(Instant at, std::string_view line) {
  const bool is_full = request_.max_size && written_ + text_.size() + line.size() > *request_.max_size;
  const bool is_old = request_.max_age && first_at_ && at - *first_at_ >= *request_.max_age;
  if (first_at_ && (is_full || is_old)) {
    flush();
    open_next();
  }
  if (!first_at_) first_at_ = at;
  put(line);
  if (text_.size() >= kBlock) flush();
}

void LogFiles::put(std::string_view line) {
  const std::size_t left = kPage - (written_ + text_.size()) % kPage;
  if (line.size() > left) {
    text_.append(left - 1, ' ');
    text_.push_back('\n');
  }
  text_.append(line);
}

void LogFiles::flush() {
  if (!link::append_whole(fd_.get(), written_, text_)) throw_errno(file_);
  written_ += text_.size();
  text_.clear();
}

}  // namespace meltbench::record
