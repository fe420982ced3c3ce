#include "bench/cli/repro_file.hpp"

#include <cerrno>
#include <filesystem>
#include <fstream>
#include <system_error>

#include "bench/cli/version.hpp"

namespace meltbench::cli {

void write_repro_file(const PreparedRun& prepared) {
  std::filesystem::create_directories(prepared.folder);
  const std::filesystem::path path = prepared.folder / "repro.toml";
  const std::filesystem::path unfinished = prepared.folder / "repro.toml.new";
  std::ofstream file{unfinished};
  file << scenario::write_repro(prepared.run, kProgramVersion);
  file.close();
  if (!file) throw std::system_error{errno, std::generic_category(), "cannot write " + path.string()};
  std::filesystem::rename(unfinished, path);
}

}  // namespace meltbench::cli
