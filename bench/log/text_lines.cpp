#include "bench/log/text_lines.hpp"

#include <fmt/format.h>

#include <cstring>

#include "bench/log/log_error.hpp"

namespace meltbench::log {

namespace {

[[noreturn]] void refuse(const std::string& place, const char* why) {
  throw LogError{fmt::format("{}: {}: this is no text log", place, why),
                 "logs are candump text, Vector ASC or BLF; each may be packed with gzip"};
}

}  // namespace

bool TextLines::fill() {
  std::memmove(buffer_.data(), buffer_.data() + first_, end_ - first_);
  end_ -= first_;
  first_ = 0;
  const std::size_t count = source_.read(std::span{buffer_}.subspan(end_, std::min(kBlock, buffer_.size() - end_)));
  end_ += count;
  return count > 0;
}

bool TextLines::next(std::string_view& line) {
  const char* start = buffer_.data() + first_;
  const char* found = static_cast<const char*>(std::memchr(start, '\n', end_ - first_));
  while (found == nullptr && end_ - first_ <= kMaxLine && fill()) {
    start = buffer_.data() + first_;
    found = static_cast<const char*>(std::memchr(start, '\n', end_ - first_));
  }
  torn_ = found == nullptr;
  if (torn_ && first_ == end_) return false;
  ++number_;
  std::size_t size = torn_ ? end_ - first_ : static_cast<std::size_t>(found - start);
  if (size > kMaxLine) refuse(place(), "a line of more than 16384 characters");
  first_ += size + (torn_ ? 0 : 1);
  if (std::memchr(start, '\0', size) != nullptr) refuse(place(), "a NUL byte");
  if (size > 0 && start[size - 1] == '\r') --size;
  line = {start, size};
  return true;
}

std::string TextLines::place() const {
  return fmt::format("{}:{}", source_.name(), number_);
}

}  // namespace meltbench::log
