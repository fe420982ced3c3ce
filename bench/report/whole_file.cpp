#include "bench/report/whole_file.hpp"

#include <cerrno>
#include <fstream>
#include <system_error>

namespace meltbench::report {

void write_whole_file(const std::filesystem::path& path, std::string_view text) {
  std::filesystem::path beside = path;
  beside += ".part";
  std::ofstream file{beside, std::ios::binary | std::ios::trunc};
  file.write(text.data(), static_cast<std::streamsize>(text.size()));
  file.close();
  std::error_code reason;
  if (!file)
    reason.assign(errno, std::generic_category());
  else
    std::filesystem::rename(beside, path, reason);
  if (!reason) return;
  std::error_code ignored;
  std::filesystem::remove(beside, ignored);
  throw std::system_error(reason, "cannot write " + path.string());
}

}  // namespace meltbench::report
