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
  if (!file) {
    const int reason = errno;
    std::error_code ignored;
    std::filesystem::remove(beside, ignored);
    throw std::system_error(reason, std::generic_category(), "cannot write " + path.string());
  }
  std::filesystem::rename(beside, path);
}

}  // namespace meltbench::report
