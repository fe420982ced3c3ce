#include "protocols/canopen/eds.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <optional>

#include <fmt/format.h>

namespace meltbench::canopen {
namespace {

constexpr std::size_t kMaxTextBytes = 4U << 20;
constexpr std::size_t kMaxEntries = 65536;

char to_lower(char c) {
  return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
}

std::string to_lower(std::string_view text) {
  std::string lower{text};
  for (char& c : lower) c = to_lower(c);
  return lower;
}

std::string_view trim(std::string_view text) {
  constexpr std::string_view kBlank = " \t\r\v\f";
  const std::size_t first = text.find_first_not_of(kBlank);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlank) - first + 1);
}

/// Text for a message: short and printable, whatever the file holds.
std::string quote(std::string_view text) {
  std::string shown;
  for (const char c : text.substr(0, 40)) shown += c >= ' ' && c <= '~' ? c : '?';
  return text.size() > 40 ? shown + "..." : shown;
}

struct Place {
  std::size_t line = 0;
  std::size_t column = 1;
};

struct Value {
  std::string_view text;
  Place place;
};

struct Section {
  std::string name;  // As written.
  Place place;
  std::map<std::string, Value, std::less<>> values;  // Keys in lower case.

  [[nodiscard]] const Value* find(std::string_view key) const {
    const auto found = values.find(to_lower(key));
    return found == values.end() || found->second.text.empty() ? nullptr : &found->second;
  }
};

using Sections = std::map<std::string, Section, std::less<>>;  // Names in lower case.

/// A whole number as written, before it is known how wide it must be.
struct Integer {
  bool negative = false;
  bool hex = false;
  std::uint64_t magnitude = 0;
};

/// Decimal, 0x hex or (leading zero) octal, as C writes them.
std::optional<Integer> parse_integer(std::string_view text) {
  Integer integer;
  if (!text.empty() && (text.front() == '-' || text.front() == '+')) {
    integer.negative = text.front() == '-';
    text.remove_prefix(1);
  }
  int base = 10;
  if (text.size() > 2 && text[0] == '0' && to_lower(text[1]) == 'x') {
    integer.hex = true;
    base = 16;
    text.remove_prefix(2);
  } else if (text.size() > 1 && text[0] == '0') {
    base = 8;
  }
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), integer.magnitude, base);
  if (error != std::errc{} || end != text.data() + text.size()) return {};
  return integer;
}

/// "$NODEID+0x180" -> 0x180 + node; also without the plus, and the other way round.
std::optional<Integer> parse_integer_with_node(std::string_view text, std::uint8_t node_id) {
  constexpr std::string_view kNodeId = "$nodeid";
  const std::string lower = to_lower(text);
  const std::size_t at = lower.find(kNodeId);
  if (at == std::string::npos) return parse_integer(text);
  const std::string_view before = trim(text.substr(0, at));
  const std::string_view after = trim(text.substr(at + kNodeId.size()));
  std::string_view offset;
  if (!before.empty()) {
    if (before.back() != '+' || !after.empty()) return {};
    offset = trim(before.substr(0, before.size() - 1));
  } else if (!after.empty()) {
    if (after.front() != '+') return {};
    offset = trim(after.substr(1));
  } else {
    return Integer{.magnitude = node_id};
  }
  auto integer = parse_integer(offset);
  const bool fits = integer && !integer->negative && integer->magnitude <= UINT64_MAX - node_id;
  if (!fits) return {};
  integer->magnitude += node_id;
  return integer;
}

/// Wire bytes if the number fits into so many; a signed one may also be written as its bit pattern in hex.
std::optional<std::vector<std::uint8_t>> to_wire(const Integer& integer, std::size_t size, bool is_signed_type) {
  const unsigned bits = 8 * static_cast<unsigned>(size);
  const std::uint64_t all = bits == 64 ? UINT64_MAX : (std::uint64_t{1} << bits) - 1;
  const std::uint64_t half = std::uint64_t{1} << (bits - 1);
  std::uint64_t highest = all;
  if (is_signed_type && !integer.hex) highest = half - 1;
  if (integer.negative) highest = is_signed_type ? half : 0;
  if (integer.magnitude > highest) return {};
  const std::uint64_t pattern = integer.negative ? ~integer.magnitude + 1 : integer.magnitude;
  std::vector<std::uint8_t> bytes(size);
  std::memcpy(bytes.data(), &pattern, size);
  return bytes;
}

template <class T>
std::optional<std::vector<std::uint8_t>> parse_real(std::string_view text) {
  T number{};
  if (!text.empty() && text.front() == '+') text.remove_prefix(1);
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc{} || end != text.data() + text.size() || !std::isfinite(number)) return {};
  return to_bytes(number);
}

std::optional<std::vector<std::uint8_t>> parse_hex_bytes(std::string_view text) {
  std::vector<std::uint8_t> bytes;
  std::string digits;
  for (const char c : text) {
    if (c == ' ' || c == '\t') continue;
    digits += c;
    if (digits.size() < 2) continue;
    std::uint8_t byte = 0;
    const auto [end, error] = std::from_chars(digits.data(), digits.data() + 2, byte, 16);
    if (error != std::errc{} || end != digits.data() + 2) return {};
    bytes.push_back(byte);
    digits.clear();
  }
  if (!digits.empty()) return {};
  return bytes;
}

/// "1018sub1" -> 0x1018, "sub1"; nothing if the name does not begin with exactly four hex digits.
std::optional<std::pair<std::uint16_t, std::string_view>> split_object_name(std::string_view name) {
  if (name.size() < 4) return {};
  std::uint16_t index = 0;
  const auto [end, error] = std::from_chars(name.data(), name.data() + 4, index, 16);
  if (error != std::errc{} || end != name.data() + 4) return {};
  return std::pair{index, name.substr(4)};
}

class Reader {
 public:
  Reader(std::string_view text, std::string_view file_name, std::uint8_t node_id)
      : text_{text}, file_name_{file_name}, node_id_{node_id} {}

  Eds read() {
    if (text_.size() > kMaxTextBytes)
      fail({1, 1}, fmt::format("{} bytes, at most {} are read", text_.size(), kMaxTextBytes));
    split_into_sections();
    read_device_info();
    read_dummy_usage();
    read_object_list("mandatoryobjects");
    read_object_list("optionalobjects");
    read_object_list("manufacturerobjects");
    if (eds_.dictionary.entries().empty()) {
      fail({1, 1}, "no objects",
           "an EDS lists its objects in [MandatoryObjects], [OptionalObjects], [ManufacturerObjects]");
    }
    warn_about_unlisted_objects();
    return std::move(eds_);
  }

 private:
  [[noreturn]] void fail(Place place, const std::string& what, std::string hint = {}) const {
    throw EdsError(fmt::format("{}:{}:{}: {}", file_name_, place.line, place.column, what), std::move(hint));
  }
  [[noreturn]] void fail_value(const Section& section, std::string_view key, const Value& value,
                               const std::string& must, std::string hint = {}) const {
    fail(value.place, fmt::format("[{}] {} = {}, {}", quote(section.name), key, quote(value.text), must),
         std::move(hint));
  }
  void warn(Place place, const std::string& what) {
    eds_.warnings.push_back(fmt::format("{}:{}: {}", file_name_, place.line, what));
  }

  void split_into_sections() {
    std::string_view rest = text_;
    if (rest.starts_with("\xEF\xBB\xBF")) rest.remove_prefix(3);
    Section* section = nullptr;
    for (std::size_t line_number = 1; !rest.empty(); ++line_number) {
      const std::size_t end = rest.find('\n');
      const std::string_view line = rest.substr(0, end);
      rest = end == std::string_view::npos ? std::string_view{} : rest.substr(end + 1);
      read_line(line, line_number, section);
    }
  }

  void read_line(std::string_view raw_line, std::size_t line_number, Section*& section) {
    const std::string_view line = trim(raw_line);
    const auto place_of = [&](std::string_view part) {
      return Place{line_number, static_cast<std::size_t>(part.data() - raw_line.data()) + 1};
    };
    if (line.empty() || line.front() == ';' || line.front() == '#') return;
    if (line.front() == '[') {
      if (line.back() != ']') fail(place_of(line), fmt::format("section {} has no closing ]", quote(line)));
      const std::string_view name = trim(line.substr(1, line.size() - 2));
      const auto [added, is_new] =
          sections_.try_emplace(to_lower(name), Section{std::string{name}, place_of(line), {}});
      if (!is_new) {
        fail(place_of(line), fmt::format("section [{}] is there twice", quote(name)),
             fmt::format("the first one is in line {}", added->second.place.line));
      }
      section = &added->second;
      return;
    }
    const std::size_t equals = line.find('=');
    if (equals == std::string_view::npos) {
      fail(place_of(line), fmt::format("expected key=value or [section], found {}", quote(line)));
    }
    if (section == nullptr) fail(place_of(line), "a key before the first [section]");
    const std::string_view key = trim(line.substr(0, equals));
    const std::string_view after = line.substr(equals + 1);
    const std::string_view value = trim(after);
    const Value entry{value, place_of(value.empty() ? after : value)};
    if (!section->values.try_emplace(to_lower(key), entry).second) {
      fail(place_of(line), fmt::format("[{}] {} is there twice", quote(section->name), quote(key)));
    }
  }

  [[nodiscard]] const Section* find_section(std::string_view lower_name) const {
    const auto found = sections_.find(lower_name);
    return found == sections_.end() ? nullptr : &found->second;
  }

  /// Number of at most `highest`, or `otherwise` if the key is missing or empty.
  [[nodiscard]] std::uint32_t read_number(const Section& section, std::string_view key, std::uint32_t otherwise,
                                          std::uint32_t highest = UINT32_MAX) const {
    const Value* const value = section.find(key);
    if (value == nullptr) return otherwise;
    const auto integer = parse_integer_with_node(value->text, node_id_);
    if (!integer || integer->negative || integer->magnitude > highest) {
      fail_value(section, key, *value, fmt::format("must be a number from 0 to {}", highest),
                 "decimal, 0x hex, or octal with a leading 0");
    }
    return static_cast<std::uint32_t>(integer->magnitude);
  }

  [[nodiscard]] static std::string read_text(const Section& section, std::string_view key) {
    const Value* const value = section.find(key);
    return value == nullptr ? std::string{} : std::string{value->text};
  }

  void read_device_info() {
    const Section* const section = find_section("deviceinfo");
    if (section == nullptr) return warn({1, 1}, "no [DeviceInfo]");
    DeviceInfo& device = eds_.device;
    device.vendor_name = read_text(*section, "VendorName");
    device.vendor_number = read_number(*section, "VendorNumber", 0);
    device.product_name = read_text(*section, "ProductName");
    device.product_number = read_number(*section, "ProductNumber", 0);
    device.revision_number = read_number(*section, "RevisionNumber", 0);
    device.order_code = read_text(*section, "OrderCode");
    device.rx_pdo_count = read_number(*section, "NrOfRXPDO", 0);
    device.tx_pdo_count = read_number(*section, "NrOfTXPDO", 0);
    device.granularity = read_number(*section, "Granularity", 8);
    device.lss_supported = read_number(*section, "LSS_Supported", 0) != 0;
    for (const unsigned rate : {10U, 20U, 50U, 125U, 250U, 500U, 800U, 1000U}) {
      if (read_number(*section, fmt::format("BaudRate_{}", rate), 0) != 0) device.bit_rates_kbit_per_s.push_back(rate);
    }
  }

  void read_dummy_usage() {
    const Section* const section = find_section("dummyusage");
    if (section == nullptr) return;
    for (std::uint16_t index = 1; index <= 7; ++index) {
      eds_.dictionary.allow_dummy(index, read_number(*section, fmt::format("Dummy{:04}", index), 0) != 0);
    }
  }

  void read_object_list(std::string_view list_name) {
    const Section* const list = find_section(list_name);
    if (list == nullptr) return;
    const std::uint32_t count = read_number(*list, "SupportedObjects", 0, 0xFFFF);
    for (std::uint32_t i = 1; i <= count; ++i) {
      const std::string key = std::to_string(i);
      const Value* const value = list->find(key);
      if (value == nullptr) {
        fail(list->place, fmt::format("[{}] {} is missing", quote(list->name), key),
             fmt::format("SupportedObjects says {}", count));
      }
      const auto index = static_cast<std::uint16_t>(read_number(*list, key, 0, 0xFFFF));
      const Section* const section = find_section(fmt::format("{:04x}", index));
      if (section == nullptr) fail_value(*list, key, *value, fmt::format("but there is no section [{:04X}]", index));
      if (eds_.dictionary.has_index(index)) fail_value(*list, key, *value, "the object is listed twice");
      read_object(index, *section);
    }
  }

  void read_object(std::uint16_t index, const Section& section) {
    constexpr std::uint32_t kDefType = 5, kDefStruct = 6;
    const std::uint32_t code = read_number(section, "ObjectType", static_cast<std::uint32_t>(ObjectCode::kVar));
    switch (code) {
      case 0:
      case kDefType:
      case kDefStruct:
        return;
      case static_cast<std::uint32_t>(ObjectCode::kVar):
      case static_cast<std::uint32_t>(ObjectCode::kDomain):
        return add_entry(section, {index, 0}, static_cast<ObjectCode>(code));
      case static_cast<std::uint32_t>(ObjectCode::kArray):
      case static_cast<std::uint32_t>(ObjectCode::kRecord):
        if (read_number(section, "CompactSubObj", 0, 254) != 0) {
          return read_compact_object(index, section, static_cast<ObjectCode>(code));
        }
        return read_sub_objects(index, section, static_cast<ObjectCode>(code));
      default:
        fail(section.place, fmt::format("[{}] ObjectType = {}, unknown", quote(section.name), code),
             "7 VAR, 8 ARRAY, 9 RECORD, 2 DOMAIN, 5 DEFTYPE, 6 DEFSTRUCT");
    }
  }

  void read_sub_objects(std::uint16_t index, const Section& section, ObjectCode code) {
    const std::string prefix = fmt::format("{:04x}sub", index);
    std::uint32_t count = 0;
    for (auto it = sections_.lower_bound(prefix); it != sections_.end() && it->first.starts_with(prefix); ++it) {
      const std::string_view digits = std::string_view{it->first}.substr(prefix.size());
      std::uint8_t sub = 0;
      const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), sub, 16);
      if (error != std::errc{} || end != digits.data() + digits.size()) {
        fail(it->second.place, fmt::format("[{}]: sub-index is not a hex number up to FF", quote(it->second.name)));
      }
      if (eds_.dictionary.find(index, sub) != nullptr) {
        fail(it->second.place, fmt::format("[{}]: sub-index {} is there twice", quote(it->second.name), sub));
      }
      add_entry(it->second, {index, sub}, code);
      ++count;
    }
    if (eds_.dictionary.find(index, 0) == nullptr) {
      fail(section.place, fmt::format("[{}] has no section [{}sub0]", quote(section.name), quote(section.name)),
           "an ARRAY or RECORD has a section for each sub-index, or CompactSubObj");
    }
    const std::uint32_t announced = read_number(section, "SubNumber", count);
    if (announced != count)
      warn(section.place, fmt::format("SubNumber = {}, but {} sub-indices follow", announced, count));
  }

  void read_compact_object(std::uint16_t index, const Section& section, ObjectCode code) {
    const auto count = static_cast<std::uint8_t>(read_number(section, "CompactSubObj", 0, 254));
    const EntryInfo common = read_entry(section, {index, 0}, code);
    EntryInfo sub_zero{.address = {index, 0},
                       .name = "NrOfObjects",
                       .object_code = code,
                       .type = DataType::kUnsigned8,
                       .access = AccessType::kReadOnly,
                       .mappable = false,
                       .default_value = {count},
                       .low_limit = {},
                       .high_limit = {}};
    add(section, std::move(sub_zero));
    const Section* const values = find_section(fmt::format("{:04x}value", index));
    const Section* const names = find_section(fmt::format("{:04x}name", index));
    for (std::uint8_t sub = 1; sub <= count; ++sub) {
      EntryInfo info = common;
      info.address.sub = sub;
      const std::string key = std::to_string(sub);
      info.name = names != nullptr && names->find(key) != nullptr ? read_text(*names, key) : common.name + key;
      if (values != nullptr && values->find(key) != nullptr) info.default_value = read_value(*values, key, info.type);
      add(section, std::move(info));
    }
  }

  void add_entry(const Section& section, ObjectAddress address, ObjectCode code) {
    add(section, read_entry(section, address, code));
  }

  void add(const Section& section, EntryInfo info) {
    if (eds_.dictionary.entries().size() >= kMaxEntries)
      fail(section.place, fmt::format("more than {} objects", kMaxEntries));
    eds_.dictionary.add(std::move(info));
  }

  [[nodiscard]] EntryInfo read_entry(const Section& section, ObjectAddress address, ObjectCode code) const {
    EntryInfo info;
    info.address = address;
    info.name = read_text(section, "ParameterName");
    info.object_code = code;
    info.type = read_type(section, code);
    info.access = read_access(section, code);
    info.mappable = read_number(section, "PDOMapping", 0, 1) != 0;
    info.default_value =
        read_value(section, section.find("ParameterValue") ? "ParameterValue" : "DefaultValue", info.type);
    if (size_of(info.type) != 0) {
      if (section.find("LowLimit") != nullptr) info.low_limit = read_value(section, "LowLimit", info.type);
      if (section.find("HighLimit") != nullptr) info.high_limit = read_value(section, "HighLimit", info.type);
    }
    return info;
  }

  [[nodiscard]] DataType read_type(const Section& section, ObjectCode code) const {
    const Value* const value = section.find("DataType");
    if (value == nullptr) {
      if (code == ObjectCode::kDomain) return DataType::kDomain;
      fail(section.place, fmt::format("[{}] DataType is missing", quote(section.name)),
           "e.g. DataType=0x0007 for UNSIGNED32");
    }
    const auto type = static_cast<DataType>(read_number(section, "DataType", 0, 0xFFFF));
    if (!is_known(type)) fail_value(section, "DataType", *value, "not a data type of CiA 301");
    return type;
  }

  [[nodiscard]] AccessType read_access(const Section& section, ObjectCode code) const {
    const Value* const value = section.find("AccessType");
    if (value == nullptr) {
      if (code == ObjectCode::kDomain) return AccessType::kReadWrite;
      fail(section.place, fmt::format("[{}] AccessType is missing", quote(section.name)),
           "ro, wo, rw, rwr, rww or const");
    }
    const std::string access = to_lower(value->text);
    if (access == "ro") return AccessType::kReadOnly;
    if (access == "wo") return AccessType::kWriteOnly;
    if (access == "rw") return AccessType::kReadWrite;
    if (access == "rww") return AccessType::kReadWriteWrite;
    if (access == "rwr") return AccessType::kReadWriteRead;
    if (access == "const") return AccessType::kConst;
    fail_value(section, "AccessType", *value, "must be ro, wo, rw, rwr, rww or const");
  }

  /// Wire bytes of a value; nothing if the key is missing or empty.
  [[nodiscard]] std::vector<std::uint8_t> read_value(const Section& section, std::string_view key,
                                                     DataType type) const {
    const Value* const value = section.find(key);
    if (value == nullptr) return {};
    std::optional<std::vector<std::uint8_t>> bytes;
    std::string hint;
    if (type == DataType::kReal32) {
      bytes = parse_real<float>(value->text);
      hint = "decimal, e.g. 1.5";
    } else if (type == DataType::kReal64) {
      bytes = parse_real<double>(value->text);
      hint = "decimal, e.g. 1.5";
    } else if (size_of(type) != 0) {
      if (const auto integer = parse_integer_with_node(value->text, node_id_)) {
        bytes = to_wire(*integer, size_of(type), is_signed(type));
      }
      hint = "decimal, 0x hex, octal with a leading 0, or $NODEID+number, within the range of the type";
    } else if (type == DataType::kVisibleString || type == DataType::kUnicodeString) {
      bytes.emplace(value->text.begin(), value->text.end());
    } else {
      bytes = parse_hex_bytes(value->text);
      hint = "bytes as pairs of hex digits";
    }
    if (!bytes) fail_value(section, key, *value, fmt::format("not a value of {}", text(type)), hint);
    const std::size_t longest = type == DataType::kDomain ? kMaxDomainBytes : kMaxStringBytes;
    if (bytes->size() > longest) fail_value(section, key, *value, fmt::format("longer than {} bytes", longest));
    return *std::move(bytes);
  }

  void warn_about_unlisted_objects() {
    for (const auto& [name, section] : sections_) {
      const auto object = split_object_name(name);
      if (!object || eds_.dictionary.has_index(object->first)) continue;
      const bool is_definition = object->first < 0x1000;
      if (object->second.empty() && !is_definition && read_number(section, "ObjectType", 7) >= 7) {
        warn(section.place, fmt::format("[{}] is in no object list and is left out", quote(section.name)));
      }
    }
  }

  std::string_view text_;
  std::string_view file_name_;
  std::uint8_t node_id_;
  Sections sections_;
  Eds eds_;
};

}  // namespace

Eds read_eds(std::string_view text, std::string_view file_name, std::uint8_t node_id) {
  if (node_id == 0 || node_id > kMaxNodeId) {
    throw EdsError(fmt::format("{}:1:1: node id {}, must be 1..{}", file_name, node_id, kMaxNodeId), {});
  }
  return Reader{text, file_name, node_id}.read();
}

}  // namespace meltbench::canopen
