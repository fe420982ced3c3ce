#include <catch2/catch.hpp>

#include "protocols/canopen/conformity.hpp"
#include "tests/plant_emulator/board/board_bench.hpp"

using namespace meltbench;

TEST_CASE("Board EDS: a conformance test finds nothing to object to", "[board][eds]") {
  for (const char* name : {"feeder", "screw_drive", "melt_pressure", "heater", "preconditioner", "melt_camera"}) {
    INFO(name);
    canopen::ObjectDictionary dictionary = board::read_board_eds(name);
    for (const std::string& fault : canopen::find_conformity_faults(dictionary)) FAIL_CHECK(fault);
  }
}

TEST_CASE("Board EDS: read without a warning, and says what the device says", "[board][eds]") {
  const std::string path = std::string{MELTBENCH_SOURCE_DIR} + "/fixtures/boards/feeder.eds";
  std::ifstream file{path};
  const std::string text{std::istreambuf_iterator<char>{file}, {}};
  const canopen::Eds eds = canopen::read_eds(text, path, 5);
  CHECK(eds.warnings.empty());
  CHECK(eds.device.product_number == eds.dictionary.at(0x1018, 2).get<std::uint32_t>());
  CHECK(eds.device.vendor_number == eds.dictionary.at(0x1018, 1).get<std::uint32_t>());
  CHECK(eds.device.rx_pdo_count == 2);
  CHECK(eds.device.tx_pdo_count == 3);
}
