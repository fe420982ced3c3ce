#pragma once
/// The object dictionary: every value of a device that the bus can see, with its type, access, limits and default.

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "protocols/canopen/types.hpp"

namespace meltbench::canopen {

/// Longest value that the bus may write into a string, and into a DOMAIN.
inline constexpr std::size_t kMaxStringBytes = 1024;
inline constexpr std::size_t kMaxDomainBytes = 65536;

/// What a dictionary entry is; does not change after it was added.
struct EntryInfo {
  ObjectAddress address;
  std::string name;
  ObjectCode object_code = ObjectCode::kVar;  ///< Of the whole index.
  DataType type = DataType::kUnsigned8;
  AccessType access = AccessType::kReadOnly;
  bool mappable = false;                               ///< May be part of a PDO.
  std::vector<std::uint8_t> default_value;             ///< Wire bytes; empty = zero, or the empty string.
  std::optional<std::vector<std::uint8_t>> low_limit;  ///< Wire bytes, same size as the type.
  std::optional<std::vector<std::uint8_t>> high_limit;
};

/// One sub-index: what it is and what it holds now. Numbers lie in the entry itself, so that a pointer to them stays
/// good for the life of the dictionary; strings and domains may grow.
class OdEntry {
 public:
  /// @throws std::invalid_argument naming the object if the type is unknown, or default or limits have not its size.
  explicit OdEntry(EntryInfo info);

  [[nodiscard]] const EntryInfo& info() const { return info_; }
  [[nodiscard]] ObjectAddress address() const { return info_.address; }

  /// Value now, as wire bytes. Valid until the next change of a string or domain.
  [[nodiscard]] std::span<const std::uint8_t> bytes() const {
    return fixed_size_ != 0 ? std::span<const std::uint8_t>{number_.data(), fixed_size_} : std::span{text_};
  }

  /// Bytes of a number in place, for PDO mapping. Empty for strings and domains.
  [[nodiscard]] std::span<std::uint8_t> number_bytes() { return {number_.data(), fixed_size_}; }

  /// Number of exactly this C++ type. @pre the entry holds one (see ObjectDictionary::bind for the checked way).
  template <class T>
  [[nodiscard]] T get() const {
    if constexpr (std::is_same_v<T, bool>) {
      return number_[0] != 0;
    } else {
      return load<T>(number_);
    }
  }
  template <class T>
  void set(T value) {
    if constexpr (std::is_same_v<T, bool>) {
      number_[0] = value ? 1 : 0;
    } else {
      store<T>(number_, 0, value);
    }
  }

  /// Any integer type, widened; signed types are sign-extended. 0 for strings and reals.
  [[nodiscard]] std::int64_t to_int64() const;

  /// True if a value of so many bytes can be held, else kTooLong or kTooShort. Only numbers have a smallest size.
  [[nodiscard]] AbortCode check_size(std::size_t size) const;

  /// Size and limits: what an SDO server answers to writing these bytes. A NaN fails against any limit.
  [[nodiscard]] AbortCode check_value(std::span<const std::uint8_t> value) const;

  /// Replaces the value without looking at access or limits. @pre check_size(value.size()) is kNone.
  void assign(std::span<const std::uint8_t> value);
  void restore_default() { assign(default_bytes_); }

  [[nodiscard]] std::size_t capacity() const;  ///< Longest value in bytes.

 private:
  EntryInfo info_;
  std::uint8_t fixed_size_;
  std::array<std::uint8_t, 8> number_{};
  std::vector<std::uint8_t> text_;
  std::vector<std::uint8_t> default_bytes_;
};

/// True if entries of this data type are read and written as T.
template <class T>
[[nodiscard]] constexpr bool holds(DataType type) {
  using enum DataType;
  if constexpr (std::is_same_v<T, bool>) return type == kBoolean;
  if constexpr (std::is_same_v<T, std::int8_t>) return type == kInteger8;
  if constexpr (std::is_same_v<T, std::int16_t>) return type == kInteger16;
  if constexpr (std::is_same_v<T, std::int32_t>) return type == kInteger32;
  if constexpr (std::is_same_v<T, std::int64_t>) return type == kInteger64;
  if constexpr (std::is_same_v<T, std::uint8_t>) return type == kUnsigned8;
  if constexpr (std::is_same_v<T, std::uint16_t>) return type == kUnsigned16;
  if constexpr (std::is_same_v<T, std::uint32_t>) return type == kUnsigned32;
  if constexpr (std::is_same_v<T, std::uint64_t>) return type == kUnsigned64;
  if constexpr (std::is_same_v<T, float>) return type == kReal32;
  if constexpr (std::is_same_v<T, double>) return type == kReal64;
  return false;
}

/// The application's handle on one number: type checked once, then a load or a store. Lives as long as the dictionary.
template <class T>
class OdValue {
 public:
  OdValue() = default;
  explicit OdValue(OdEntry& entry) : entry_{&entry} {}
  [[nodiscard]] T get() const { return entry_->get<T>(); }
  void set(T value) const { entry_->set<T>(value); }
  [[nodiscard]] OdEntry& entry() const { return *entry_; }

 private:
  OdEntry* entry_ = nullptr;
};

/// Entries by index and sub-index. Entries never move in memory, also not when the dictionary is moved; it cannot be
/// copied by accident, because handles would stay with the original.
class ObjectDictionary {
 public:
  ObjectDictionary() = default;
  ObjectDictionary(ObjectDictionary&&) = default;
  ObjectDictionary& operator=(ObjectDictionary&&) = default;
  ObjectDictionary(const ObjectDictionary&) = delete;
  ObjectDictionary& operator=(const ObjectDictionary&) = delete;
  ~ObjectDictionary() = default;

  /// @throws std::invalid_argument if the address is taken, or as OdEntry does.
  OdEntry& add(EntryInfo info);

  /// Short form for tables in code: a single value with its default.
  template <class T>
  OdEntry& add_number(std::uint16_t index, std::uint8_t sub, DataType type, AccessType access, T default_value,
                      bool mappable = false, ObjectCode code = ObjectCode::kVar) {
    return add({.address = {index, sub},
                .name = {},
                .object_code = code,
                .type = type,
                .access = access,
                .mappable = mappable,
                .default_value = to_bytes(default_value),
                .low_limit = {},
                .high_limit = {}});
  }

  /// nullptr if there is none. Cost: logarithmic; meant for set-up and SDO, not for the loop.
  [[nodiscard]] OdEntry* find(std::uint16_t index, std::uint8_t sub);
  [[nodiscard]] const OdEntry* find(std::uint16_t index, std::uint8_t sub) const;
  [[nodiscard]] bool has_index(std::uint16_t index) const;

  /// @throws std::out_of_range naming the object.
  [[nodiscard]] OdEntry& at(std::uint16_t index, std::uint8_t sub = 0);
  [[nodiscard]] const OdEntry& at(std::uint16_t index, std::uint8_t sub = 0) const;

  /// Handle for the loop. @throws std::out_of_range if absent, std::invalid_argument if it is not of that type.
  template <class T>
  [[nodiscard]] OdValue<T> bind(std::uint16_t index, std::uint8_t sub = 0) {
    OdEntry& entry = at(index, sub);
    if (!holds<T>(entry.info().type)) throw_wrong_type(entry);
    return OdValue<T>{entry};
  }

  /// Number in the entry, or `otherwise` if there is no such entry. For optional objects of the profile.
  [[nodiscard]] std::int64_t integer_or(std::uint16_t index, std::uint8_t sub, std::int64_t otherwise) const;

  /// What a read or write through SDO is answered, checks in the order index, sub, access, length, value.
  /// A check without a value (size known or not) is what happens when a transfer begins.
  [[nodiscard]] AbortCode check_read(ObjectAddress address) const;
  [[nodiscard]] AbortCode check_write(ObjectAddress address, std::optional<std::size_t> size) const;
  [[nodiscard]] AbortCode check_write(ObjectAddress address, std::span<const std::uint8_t> value) const;

  /// Data types 0x0001..0x0007 that a receive PDO may name as a gap ([DummyUsage] of the EDS).
  void allow_dummy(std::uint16_t index, bool allowed);
  [[nodiscard]] bool is_dummy_allowed(std::uint16_t index) const;

  using Entries = std::map<ObjectAddress, OdEntry>;
  [[nodiscard]] Entries& entries() { return entries_; }
  [[nodiscard]] const Entries& entries() const { return entries_; }

 private:
  [[noreturn]] static void throw_absent(ObjectAddress address);
  [[noreturn]] static void throw_wrong_type(const OdEntry& entry);

  Entries entries_;
  std::uint32_t dummies_ = 0;  // Bit n: index n is allowed.
};

}  // namespace meltbench::canopen
