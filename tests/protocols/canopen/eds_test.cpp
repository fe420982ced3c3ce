#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>

#include <catch2/catch.hpp>

#include "protocols/canopen/conformity.hpp"
#include "protocols/canopen/eds.hpp"
#include "tests/protocols/canopen/test_device.hpp"

using namespace meltbench::canopen;

namespace {

const std::string kSmall = R"([FileInfo]
FileName=small.eds

[DeviceInfo]
VendorName=Example works
VendorNumber=0x1F
ProductNumber=012
RevisionNumber=65537
BaudRate_500=1
BaudRate_125=1
NrOfTXPDO=1
Granularity=8

[DummyUsage]
Dummy0005=1
Dummy0007=0

[MandatoryObjects]
SupportedObjects=2
1=0x1000
2=0x1018

[OptionalObjects]
SupportedObjects=4
1=0x1008
2=0x1016
3=0x1800
4=0x6000

[1000]
ParameterName=Device type
ObjectType=0x7
DataType=0x0007
AccessType=ro
DefaultValue=0x00020194
PDOMapping=0

[1018]
ParameterName=Identity
ObjectType=0x9
SubNumber=2

[1018sub0]
ParameterName=Highest
DataType=0x0005
AccessType=const
DefaultValue=1

[1018sub1]
ParameterName=Vendor
DataType=0x0007
AccessType=ro
DefaultValue=0x1F

[1008]
ParameterName=Name
DataType=0x0009
AccessType=CONST
DefaultValue=Small device; really

[1016]
ParameterName=Consumer heartbeat time
ObjectType=8
DataType=7
AccessType=rw
DefaultValue=0x10
CompactSubObj=3

[1016Value]
NrOfEntries=1
2=0x7F0064

[1016Name]
NrOfEntries=1
2=Manager

[1800]
ParameterName=TPDO 1
ObjectType=9
SubNumber=2

[1800sub0]
DataType=5
AccessType=ro
DefaultValue=1

[1800SUB1]
datatype=0x0007
ACCESSTYPE=rw
DEFAULTVALUE=$nodeId + 0x40000180

[6000]
ParameterName=Temperature
DataType=0x0003
AccessType=rww
DefaultValue=-5
ParameterValue=0xFFF6
LowLimit=-10
HighLimit=100
PDOMapping=1
)";

Eds read(const std::string& text) {
  return read_eds(text, "small.eds", 9);
}

std::string replace(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  REQUIRE(at != std::string::npos);
  return text.replace(at, from.size(), to);
}

std::string message_of(const std::string& text) {
  try {
    read(text);
  } catch (const EdsError& error) {
    return error.what();
  }
  return "no error";
}

}  // namespace

TEST_CASE("EDS: objects have the type, access, limits and value that the file gives them", "[canopen][eds]") {
  const Eds eds = read(kSmall);
  const ObjectDictionary& od = eds.dictionary;
  CHECK(eds.warnings.empty());
  CHECK(od.entries().size() == 11);
  CHECK(od.at(0x1000).get<std::uint32_t>() == 0x00020194);
  CHECK(od.at(0x1018, 1).info().name == "Vendor");
  CHECK(od.at(0x1018, 1).info().object_code == ObjectCode::kRecord);
  CHECK(od.at(0x1018, 0).info().access == AccessType::kConst);
  const auto name = od.at(0x1008).bytes();
  CHECK(std::string(name.begin(), name.end()) == "Small device; really");
  CHECK(od.at(0x1800, 1).get<std::uint32_t>() == 0x4000'0189);
  const OdEntry& temperature = od.at(0x6000);
  CHECK(temperature.get<std::int16_t>() == -10);  // ParameterValue beats DefaultValue.
  CHECK(temperature.info().access == AccessType::kReadWriteWrite);
  CHECK(temperature.info().mappable);
  CHECK(temperature.check_value(to_bytes(std::int16_t{101})) == AbortCode::kTooHigh);
  CHECK(temperature.check_value(to_bytes(std::int16_t{-11})) == AbortCode::kTooLow);
}

TEST_CASE("EDS: a compact object gets all its sub-indices, with the values and names listed beside it",
          "[canopen][eds]") {
  const Eds eds = read(kSmall);
  CHECK(eds.dictionary.at(0x1016, 0).get<std::uint8_t>() == 3);
  CHECK(eds.dictionary.at(0x1016, 1).get<std::uint32_t>() == 0x10);
  CHECK(eds.dictionary.at(0x1016, 2).get<std::uint32_t>() == 0x7F0064);
  CHECK(eds.dictionary.at(0x1016, 2).info().name == "Manager");
  CHECK(eds.dictionary.at(0x1016, 3).info().name == "Consumer heartbeat time3");
}

TEST_CASE("EDS: the device is described, the dummies are as the file allows them", "[canopen][eds]") {
  const Eds eds = read(kSmall);
  CHECK(eds.device.vendor_name == "Example works");
  CHECK(eds.device.vendor_number == 0x1F);
  CHECK(eds.device.product_number == 10);  // Octal, as a leading 0 says.
  CHECK(eds.device.revision_number == 65537);
  CHECK(eds.device.bit_rates_kbit_per_s == std::vector<unsigned>{125, 500});
  CHECK(eds.device.tx_pdo_count == 1);
  CHECK(eds.dictionary.is_dummy_allowed(5));
  CHECK_FALSE(eds.dictionary.is_dummy_allowed(7));
}

TEST_CASE("EDS: Windows line ends, a byte order mark, upper case and comments change nothing", "[canopen][eds]") {
  std::string text = "\xEF\xBB\xBF; comment\n";
  for (const char c : kSmall) text += c == '\n' ? std::string{"\r\n"} : std::string(1, c);
  const Eds eds = read(replace(text, "[1018sub1]", "[1018SUB1]"));
  CHECK(eds.dictionary.entries().size() == 11);
  CHECK(eds.dictionary.at(0x1800, 1).get<std::uint32_t>() == 0x4000'0189);
}

TEST_CASE("EDS: what is wrong is said with file, line, column and the value", "[canopen][eds]") {
  using Catch::Equals;
  CHECK_THAT(message_of(replace(kSmall, "DefaultValue=0x00020194", "DefaultValue=0x1FFFFFFFF")),
             Equals("small.eds:35:14: [1000] DefaultValue = 0x1FFFFFFFF, not a value of UNSIGNED32"));
  CHECK_THAT(message_of(replace(kSmall, "AccessType=ro", "AccessType = read")),
             Equals("small.eds:34:14: [1000] AccessType = read, must be ro, wo, rw, rwr, rww or const"));
  CHECK_THAT(message_of(replace(kSmall, "DataType=0x0007", "DataType=0x0066")),
             Equals("small.eds:33:10: [1000] DataType = 0x0066, not a data type of CiA 301"));
  CHECK_THAT(message_of(replace(kSmall, "[1018sub0]", "[1018sub7]")),
             Equals("small.eds:38:1: [1018] has no section [1018sub0]"));
  CHECK_THAT(message_of(replace(kSmall, "2=0x1018", "2=0x2018")),
             Equals("small.eds:21:3: [MandatoryObjects] 2 = 0x2018, but there is no section [2018]"));
  CHECK_THAT(message_of(replace(kSmall, "2=0x1018", "3=0x1018")),
             Equals("small.eds:18:1: [MandatoryObjects] 2 is missing"));
  CHECK_THAT(message_of(replace(kSmall, "[1008]", "[1000]")), Equals("small.eds:55:1: section [1000] is there twice"));
  CHECK_THAT(message_of(replace(kSmall, "[1008]", "[1008")), Equals("small.eds:55:1: section [1008 has no closing ]"));
  CHECK_THAT(message_of(replace(kSmall, "ObjectType=0x7", "ObjectType 7")),
             Equals("small.eds:32:1: expected key=value or [section], found ObjectType 7"));
  CHECK_THAT(message_of(replace(kSmall, "HighLimit=100", "HighLimit=40000")),
             Equals("small.eds:99:11: [6000] HighLimit = 40000, not a value of INTEGER16"));
  CHECK_THAT(message_of(""), Equals("small.eds:1:1: no objects"));
  CHECK_THROWS_AS(read_eds(kSmall, "small.eds", 0), EdsError);
}

TEST_CASE("EDS: an object in no list and a wrong SubNumber are warned of", "[canopen][eds]") {
  std::string text = replace(kSmall, "SubNumber=2", "SubNumber=5");
  text = replace(text, "4=0x6000", "").replace(text.find("SupportedObjects=4"), 18, "SupportedObjects=3");
  const Eds eds = read(text);
  REQUIRE(eds.warnings.size() == 2);
  CHECK(eds.warnings[0] == "small.eds:38: SubNumber = 5, but 2 sub-indices follow");
  CHECK_THAT(eds.warnings[1], Catch::Contains("[6000] is in no object list"));
}

TEST_CASE("EDS: any bytes give a dictionary or an EdsError", "[canopen][eds][robustness]") {
  std::mt19937 random{1};
  unsigned refused = 0;
  for (int i = 0; i < 3000; ++i) {
    std::string text = kSmall;
    for (unsigned changes = random() % 8 + 1; changes > 0; --changes) {
      const std::size_t at = random() % text.size();
      switch (random() % 4) {
        case 0:
          text[at] = static_cast<char>(random());
          break;
        case 1:
          text.erase(at, random() % 40);
          break;
        case 2:
          text.insert(at, text.substr(random() % text.size(), random() % 60));
          break;
        default:
          text[at] = "=[]$;-0x9\n"[random() % 10];
          break;
      }
    }
    try {
      Eds eds = read(text);
      const auto faults = find_conformity_faults(eds.dictionary);
      for (const std::string& fault : faults) REQUIRE_FALSE(fault.empty());
    } catch (const EdsError&) {
      ++refused;
    }
  }
  CHECK(refused > 1000);
}

TEST_CASE("EDS: every board of the project is conformant and makes a node", "[canopen][eds]") {
  unsigned boards = 0;
  for (const auto& file : std::filesystem::directory_iterator(MELTBENCH_SOURCE_DIR "/fixtures/boards")) {
    if (file.path().extension() != ".eds") continue;
    INFO(file.path());
    std::stringstream text;
    text << std::ifstream{file.path()}.rdbuf();
    Eds eds = read_eds(text.str(), file.path().string(), 3);
    CHECK(eds.warnings == std::vector<std::string>{});
    CHECK(find_conformity_faults(eds.dictionary) == std::vector<std::string>{});
    CHECK_NOTHROW(Node(std::move(eds.dictionary), 3));
    ++boards;
  }
  CHECK(boards >= 3);
}

TEST_CASE("Conformity: each broken rule is found and named", "[canopen][eds]") {
  const auto faults_of = [](auto change) {
    ObjectDictionary od;
    od.add_number(0x1000, 0, DataType::kUnsigned32, AccessType::kReadOnly, 0x194U);
    od.add_number(0x1001, 0, DataType::kUnsigned8, AccessType::kReadOnly, std::uint8_t{0});
    od.add_number(0x1017, 0, DataType::kUnsigned16, AccessType::kReadWrite, std::uint16_t{0});
    od.add_number(0x1018, 0, DataType::kUnsigned8, AccessType::kReadOnly, std::uint8_t{1}, false, ObjectCode::kRecord);
    od.add_number(0x1018, 1, DataType::kUnsigned32, AccessType::kReadOnly, 0U, false, ObjectCode::kRecord);
    change(od);
    const auto faults = find_conformity_faults(od);
    std::string all;
    for (const auto& fault : faults) all += fault + "\n";
    return all;
  };
  CHECK(faults_of([](ObjectDictionary&) {}).empty());
  CHECK(faults_of([](ObjectDictionary& od) {
          od.entries().erase({0x1001, 0});
        }) == "0x1001:0 is mandatory and missing\n");
  CHECK(faults_of([](ObjectDictionary& od) { od.at(0x1018, 0).set<std::uint8_t>(4); }) ==
        "0x1018:0 is 4, the highest sub-index is 1\n");
  CHECK(faults_of([](ObjectDictionary& od) {
          od.add({.address = {0x2000, 0},
                  .name = {},
                  .default_value = {9},
                  .low_limit = {},
                  .high_limit = std::vector<std::uint8_t>{8}});
        }) == "0x2000:0: default: value is too high\n");
  CHECK(faults_of([](ObjectDictionary& od) {
          od.add({.address = {0x2000, 0},
                  .name = {},
                  .default_value = {9},
                  .low_limit = std::vector<std::uint8_t>{9},
                  .high_limit = std::vector<std::uint8_t>{8}});
        }) == "0x2000:0: low limit above the high limit\n");
  CHECK(faults_of([](ObjectDictionary& od) {
          od.add_number(0x1800, 1, DataType::kUnsigned32, AccessType::kReadWrite, 0x185U);
        }) == "0x1800 and 0x1A00 must both be there, or neither\n");
  CHECK(faults_of([](ObjectDictionary& od) {
          od.add_number(0x1800, 1, DataType::kUnsigned32, AccessType::kReadWrite, 0x185U);
          od.add_number(0x1A00, 0, DataType::kUnsigned8, AccessType::kReadWrite, std::uint8_t{1});
          od.add_number(0x1A00, 1, DataType::kUnsigned32, AccessType::kReadWrite, 0x1000'0020U);
        }) == "PDO 0x1800 with mapping 0x1A00: object cannot be mapped to the PDO\n");
}
