// The parser is compiled into this file, not taken from the distribution's shared library, so that the nesting limit is
// ours and a fuzzer sees inside.
#undef TOML_SHARED_LIB
#undef TOML_HEADER_ONLY
#define TOML_HEADER_ONLY 1
#define TOML_MAX_NESTED_VALUES 32

#include "protocols/config/toml.hpp"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <fstream>
#include <iterator>
#include <system_error>

namespace meltbench::config {
namespace {

// A key of that many dots makes tables nested that deep, and everything that walks a tree calls itself once per level.
constexpr int kMaxDots = 64;

using FileName = std::shared_ptr<const std::string>;

Origin origin_of(const toml::source_region& source, const FileName& file) {
  return Origin{file, source.begin.line, source.begin.column};
}

/// The library does not limit "a.a.a. ... = 1". Counts the dots of each stretch that can be one key; a text with as
/// many full stops and neither comma nor line break in it is refused too, which is the price of not parsing here.
void refuse_deep_keys(std::string_view text, const FileName& file) {
  std::uint32_t line = 1;
  int dots = 0;
  for (const char letter : text) {
    if (letter == '\n') ++line;
    if (std::string_view{"\n,={}[]"}.find(letter) != std::string_view::npos) dots = 0;
    if (letter == '.' && ++dots > kMaxDots) {
      throw ConfigError{Origin{file, line, 1}, fmt::format("more than {} dots in one key or text", kMaxDots),
                        "break a long text over several lines with \"\"\""};
    }
  }
}

Table convert_table(const toml::table& from, const FileName& file);

Value convert(const toml::node& node, const FileName& file) {
  const Origin origin = origin_of(node.source(), file);
  switch (node.type()) {
    case toml::node_type::boolean:
      return Value{node.as_boolean()->get(), origin};
    case toml::node_type::integer:
      return Value{node.as_integer()->get(), origin};
    case toml::node_type::floating_point:
      return Value{node.as_floating_point()->get(), origin};
    case toml::node_type::string:
      return Value{node.as_string()->get(), origin};
    case toml::node_type::table:
      return Value{convert_table(*node.as_table(), file), origin};
    case toml::node_type::array: {
      Array items;
      items.reserve(node.as_array()->size());
      for (const toml::node& item : *node.as_array()) items.push_back(convert(item, file));
      return Value{std::move(items), origin};
    }
    default:
      throw ConfigError{origin, "a date or time of day has no meaning here",
                        "times are seconds from the start of the run"};
  }
}

Table convert_table(const toml::table& from, const FileName& file) {
  std::vector<Entry> entries;
  entries.reserve(from.size());
  for (const auto& [key, node] : from) {
    entries.push_back(Entry{std::string{key.str()}, origin_of(key.source(), file), convert(node, file)});
  }
  // The library sorts by name; people expect the order in which they wrote.
  std::stable_sort(entries.begin(), entries.end(), [](const Entry& left, const Entry& right) {
    return std::pair{left.key_origin.line, left.key_origin.column} <
           std::pair{right.key_origin.line, right.key_origin.column};
  });
  Table table;
  table.origin = origin_of(from.source(), file);
  for (Entry& entry : entries) table.append(std::move(entry));
  return table;
}

[[noreturn]] void throw_syntax_error(const toml::parse_error& error, const FileName& file) {
  const std::string_view text = error.description();
  std::string message = fmt::format("not valid TOML: {}", text);
  std::string hint = "one \"key = value\" per line, texts in quotes, tables as [name]; see https://toml.io/en/v1.0.0";
  if (text.find("redefine") != std::string_view::npos) {
    hint = "a key or table may be given once in a file; a list of tables is written [[name]]";
  }
  throw ConfigError{origin_of(error.source(), file), message, std::move(hint)};
}

// --- writing

bool is_bare_key(std::string_view key) {
  return !key.empty() && std::all_of(key.begin(), key.end(), [](char letter) {
    return (letter >= 'a' && letter <= 'z') || (letter >= 'A' && letter <= 'Z') || (letter >= '0' && letter <= '9') ||
           letter == '_' || letter == '-';
  });
}

void append_text(std::string& out, std::string_view text) {
  out += '"';
  for (const char letter : text) {
    const auto code = static_cast<unsigned char>(letter);
    if (letter == '"' || letter == '\\') {
      out += '\\';
      out += letter;
    } else if (letter == '\n') {
      out += "\\n";
    } else if (code < 0x20 || code == 0x7F) {
      fmt::format_to(std::back_inserter(out), "\\u{:04X}", code);
    } else {
      out += letter;
    }
  }
  out += '"';
}

void append_key(std::string& out, std::string_view key) {
  if (is_bare_key(key)) {
    out += key;
  } else {
    append_text(out, key);
  }
}

void append_double(std::string& out, double value) {
  if (std::isnan(value)) {
    out += std::signbit(value) ? "-nan" : "nan";
    return;
  }
  const std::string shortest = fmt::format("{}", value);  // Shortest text that reads back as the same double.
  out += shortest;
  if (shortest.find_first_of(".ein") == std::string::npos) out += ".0";  // Else it would read back as an integer.
}

void append_inline(std::string& out, const Value& value);

void append_inline_table(std::string& out, const Table& table) {
  out += '{';
  const char* separator = "";
  for (const Entry& entry : table.entries()) {
    out += separator;
    append_key(out, entry.key);
    out += " = ";
    append_inline(out, entry.value);
    separator = ", ";
  }
  out += '}';
}

void append_inline(std::string& out, const Value& value) {
  if (const auto* flag = std::get_if<bool>(&value.data)) {
    out += *flag ? "true" : "false";
  } else if (const auto* whole = std::get_if<std::int64_t>(&value.data)) {
    fmt::format_to(std::back_inserter(out), "{}", *whole);
  } else if (const auto* number = std::get_if<double>(&value.data)) {
    append_double(out, *number);
  } else if (const auto* text = std::get_if<std::string>(&value.data)) {
    append_text(out, *text);
  } else if (const auto* table = std::get_if<Table>(&value.data)) {
    append_inline_table(out, *table);
  } else {
    out += '[';
    const char* separator = "";
    for (const Value& item : std::get<Array>(value.data)) {
      out += separator;
      append_inline(out, item);
      separator = ", ";
    }
    out += ']';
  }
}

/// True for what is written as [[key]] tables.
bool is_table_list(const Value& value) {
  const auto* items = std::get_if<Array>(&value.data);
  return items != nullptr && !items->empty() && std::all_of(items->begin(), items->end(), [](const Value& item) {
           return std::holds_alternative<Table>(item.data);
         });
}

void append_table(std::string& out, const Table& table, const std::string& path) {
  const auto is_plain = [](const Value& value) {
    return !std::holds_alternative<Table>(value.data) && !is_table_list(value);
  };
  for (const Entry& entry : table.entries()) {
    if (!is_plain(entry.value)) continue;
    append_key(out, entry.key);
    out += " = ";
    append_inline(out, entry.value);
    out += '\n';
  }
  for (const Entry& entry : table.entries()) {
    if (is_plain(entry.value)) continue;
    std::string child = path.empty() ? "" : path + '.';
    append_key(child, entry.key);
    if (const auto* inner = std::get_if<Table>(&entry.value.data)) {
      fmt::format_to(std::back_inserter(out), "{}[{}]\n", out.empty() ? "" : "\n", child);
      append_table(out, *inner, child);
      continue;
    }
    for (const Value& item : std::get<Array>(entry.value.data)) {
      fmt::format_to(std::back_inserter(out), "{}[[{}]]\n", out.empty() ? "" : "\n", child);
      append_table(out, std::get<Table>(item.data), child);
    }
  }
}

}  // namespace

Table parse_toml(std::string_view text, std::string_view file_name) {
  const auto file = std::make_shared<const std::string>(file_name);
  if (text.size() > kMaxTomlBytes) {
    throw ConfigError{Origin{file, 0, 0}, fmt::format("{} bytes, at most {} are read", text.size(), kMaxTomlBytes)};
  }
  refuse_deep_keys(text, file);
  try {
    return convert_table(toml::parse(text, file_name), file);
  } catch (const toml::parse_error& error) {
    throw_syntax_error(error, file);
  }
}

std::shared_ptr<const Table> read_toml_file(const std::filesystem::path& file, const Origin& asked_by) {
  const auto refuse = [&](std::string_view why) {
    throw ConfigError{asked_by, fmt::format("cannot read \"{}\": {}", file.string(), why),
                      asked_by.file ? "the path is relative to the folder of the file that says it"
                                    : "the path is relative to the current folder"};
  };
  std::error_code error;
  if (std::filesystem::is_directory(file, error)) refuse("it is a folder");
  std::ifstream stream{file, std::ios::binary};
  if (!stream) refuse(std::generic_category().message(errno));
  // One byte more than allowed is enough to be refused: /dev/zero has no end.
  std::string text(kMaxTomlBytes + 1, '\0');
  stream.read(text.data(), static_cast<std::streamsize>(text.size()));
  if (stream.bad()) refuse("reading failed");
  text.resize(static_cast<std::size_t>(stream.gcount()));
  return std::make_shared<const Table>(parse_toml(text, file.string()));
}

std::string write_toml(const Table& table) {
  std::string out;
  append_table(out, table, "");
  return out;
}

std::string write_toml(const Value& value) {
  std::string out;
  append_inline(out, value);
  return out;
}

}  // namespace meltbench::config
