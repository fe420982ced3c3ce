#include "bench/record/block_file.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <system_error>

namespace meltbench::record {

BlockFile::BlockFile(const std::filesystem::path& path)
    : path_{path.string()}, fd_{::open(path_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644)} {
  if (fd_ < 0) throw std::system_error(errno, std::generic_category(), "cannot write " + path_);
  text_.reserve(kBlock + 4096);
}

BlockFile::~BlockFile() {
  flush();
  ::close(fd_);
}

void BlockFile::flush() noexcept {
  const char* next = text_.data();
  std::size_t left = error_.empty() ? text_.size() : 0;
  while (left > 0) {
    const ssize_t written = ::write(fd_, next, left);
    if (written < 0) {
      if (errno == EINTR) continue;
      error_ = path_ + ": " + std::strerror(errno);
      break;
    }
    next += written;
    left -= static_cast<std::size_t>(written);
  }
  text_.clear();
}

}  // namespace meltbench::record
