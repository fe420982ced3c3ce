#include "protocols/link/write_all.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/resource.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <string>

#include "protocols/link/unique_fd.hpp"
#include "tests/tools/temporary_folder.hpp"

using namespace meltbench;

namespace {

/// No file of this process grows beyond a size, as on a full disk, while this object lives.
class FullDisk {
 public:
  explicit FullDisk(rlim_t size) : old_handler_{::signal(SIGXFSZ, SIG_IGN)} {
    ::getrlimit(RLIMIT_FSIZE, &old_);
    const rlimit limit{size, old_.rlim_max};
    ::setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FullDisk() {
    ::setrlimit(RLIMIT_FSIZE, &old_);
    ::signal(SIGXFSZ, old_handler_);
  }
  FullDisk(const FullDisk&) = delete;
  FullDisk& operator=(const FullDisk&) = delete;

 private:
  rlimit old_{};
  sighandler_t old_handler_;
};

}  // namespace

TEST_CASE("Write: a block that a full disk takes only a part of is cut off again, and the reason is kept", "[link]") {
  const test::TemporaryFolder folder;
  const std::string path = folder / "log";
  const link::UniqueFd file{::open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600)};
  const std::string block(3000, 'x');
  bool first = false;
  bool second = true;
  int reason = 0;
  {
    const FullDisk disk{5000};
    first = link::append_whole(file.get(), 0, block);
    second = link::append_whole(file.get(), block.size(), block);
    reason = errno;
  }
  CHECK(first);
  CHECK_FALSE(second);
  CHECK(reason == EFBIG);
  CHECK(std::filesystem::file_size(path) == block.size());
}
