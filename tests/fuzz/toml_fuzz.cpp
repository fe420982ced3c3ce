// Rigs and scenarios of strangers: whatever the bytes, the reader answers with a tree or with a ConfigError, a tree
// that is written reads back equal, and the strict rig reader copes with any tree.

#include <memory>
#include <string>

#include "protocols/config/rig.hpp"
#include "protocols/config/section.hpp"
#include "protocols/config/toml.hpp"
#include "tests/fuzz/fuzz.hpp"

using namespace meltbench;
using fuzz::must;

namespace {

void read_as_rig(const config::Table& table) {
  try {
    const config::Section root{std::make_shared<const config::Table>(table)};
    const config::Rig rig = config::read_rig(root);
    for (const config::TimelineEvent& event : config::read_events(root, rig)) event.section.finish();
    root.finish();
  } catch (const config::ConfigError& error) {
    must(error.what()[0] != '\0', "a complaint has words");
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  config::Table table;
  try {
    table = config::parse_toml(fuzz::as_text(data, size), "fuzz.toml");
  } catch (const config::ConfigError& error) {
    must(error.origin().file != nullptr, "a complaint names the file");
    return 0;
  }
  // Compared as text: NaN is not equal to itself.
  const std::string written = config::write_toml(table);
  must(config::write_toml(config::parse_toml(written, "again.toml")) == written, "a written tree reads back equal");

  config::Table merged = table;
  config::merge(merged, table);
  must(config::write_toml(merged) == written, "a tree laid over itself changes nothing");
  read_as_rig(table);
  return 0;
}
