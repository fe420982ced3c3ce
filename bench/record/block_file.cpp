#include "bench/record/block_file.hpp"

#include <fcntl.h>

#include <cerrno>
#include <cstring>
#include <system_error>

#include "protocols/link/write_all.hpp"

namespace meltbench::record {

BlockFile::BlockFile(const std::filesystem::path& path)
    : path_{path.string()}, fd_{::open(path_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644)} {
  if (!fd_) throw std::system_error(errno, std::generic_category(), "cannot write " + path_);
  text_.reserve(kBlock + 4096);
}

BlockFile::~BlockFile() {
  flush();
}

void BlockFile::flush() noexcept {
  if (error_.empty()) {
    if (link::append_whole(fd_.get(), written_, text_))
      written_ += text_.size();
    else
      error_ = path_ + ": " + std::strerror(errno);
  }
  text_.clear();
}

}  // namespace meltbench::record
