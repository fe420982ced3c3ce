#include "bench/fault/torture.hpp"

#include <catch2/catch.hpp>
#include <memory>
#include <set>
#include <string>

#include "protocols/config/toml.hpp"

using namespace meltbench;

TEST_CASE("Faults by chance are such as the reader accepts, meet every target, and come from the seed alone",
          "[fault]") {
  for (const std::string rig_file : {"bizone.toml", "coupled.toml"}) {
    const config::Section root{config::read_toml_file(std::string{MELTBENCH_SOURCE_DIR "/fixtures/rigs/"} + rig_file)};
    const config::Rig rig = config::read_rig(root);
    const fault::Scope scope = fault::make_scope(root, rig);
    std::set<std::string> met;
    for (std::uint64_t seed = 1; seed <= 500; ++seed) {
      const config::Array drawn = fault::draw_faults(seed, scope, 25s);
      CHECK(drawn == fault::draw_faults(seed, scope, 25s));
      config::Table tree;
      tree.set("fault", config::Value{drawn, {}});
      const config::Section faults{std::make_shared<const config::Table>(std::move(tree))};
      for (const fault::Fault& fault : fault::read_faults(faults, scope)) {
        met.insert(std::string{fault::name_of(fault.target)} + "." + fault.object);
      }
    }
    CHECK(met.size() == fault::list_targets(scope).size());
  }
}
