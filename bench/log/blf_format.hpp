#pragma once
/// Layout of Vector's binary log, as python-can (can/io/blf.py, LGPL) and Wireshark (wiretap/blf.h) know it; there is
/// no published description. All numbers little-endian, as on the machines that this runs on.

#include <array>
#include <bit>
#include <cstdint>

namespace meltbench::log::blf {

static_assert(std::endian::native == std::endian::little, "BLF structures are written as they lie in memory");

struct SystemTime {
  std::uint16_t year, month, day_of_week, day, hour, minute, second, milliseconds;
};

struct FileHeader {
  std::array<char, 4> signature{'L', 'O', 'G', 'G'};
  std::uint32_t header_size = 144;
  std::uint8_t application_id = 0;
  std::array<std::uint8_t, 3> application_version{};
  std::array<std::uint8_t, 4> format_version{2, 6, 8, 1};
  std::uint64_t file_size = 0;
  std::uint64_t unpacked_size = 0;
  std::uint32_t object_count = 0;
  std::uint32_t objects_read = 0;
  SystemTime start{};
  SystemTime end{};
  std::array<std::uint8_t, 72> reserved{};
};
static_assert(sizeof(FileHeader) == 144);

struct ObjectHeader {
  std::array<char, 4> signature{'L', 'O', 'B', 'J'};
  std::uint16_t header_size = 0;  ///< With the second part.
  std::uint16_t header_version = 1;
  std::uint32_t object_size = 0;  ///< With all headers; objects begin at multiples of 4.
  std::uint32_t type = 0;
};
static_assert(sizeof(ObjectHeader) == 16);

/// Second part of an object's header, of versions 1 and 2: flags and stamp lie alike in both.
struct StampHeader {
  std::uint32_t flags = 2;  ///< 1: stamp in 10 us, 2: in 1 ns.
  std::uint16_t client = 0;
  std::uint16_t object_version = 0;
  std::uint64_t stamp = 0;  ///< Since FileHeader::start.
};
static_assert(sizeof(StampHeader) == 16);

struct ContainerHeader {
  std::uint16_t packing = 2;  ///< 0: none, 2: zlib.
  std::array<std::uint8_t, 6> reserved{};
  std::uint32_t unpacked_size = 0;
  std::array<std::uint8_t, 4> reserved2{};
};
static_assert(sizeof(ContainerHeader) == 16);

enum ObjectType : std::uint32_t {
  kCanMessage = 1,
  kContainer = 10,
  kCanErrorExt = 73,
  kCanMessage2 = 86,
  kCanFdMessage = 100,
  kCanFdMessage64 = 101
};

inline constexpr std::uint32_t kExtendedId = 0x8000'0000;
inline constexpr std::uint8_t kSent = 0x01;
inline constexpr std::uint8_t kRemote = 0x80;

struct CanMessage {
  std::uint16_t channel = 1;
  std::uint8_t flags = 0;
  std::uint8_t dlc = 0;
  std::uint32_t id = 0;
  std::array<std::uint8_t, 8> data{};
};
static_assert(sizeof(CanMessage) == 16);

struct CanErrorExt {
  std::uint16_t channel = 1;
  std::uint16_t length = 0;
  std::uint32_t flags = 0;
  std::uint8_t ecc = 0;
  std::uint8_t position = 0;
  std::uint8_t dlc = 0;
  std::uint8_t reserved = 0;
  std::uint32_t frame_length_ns = 0;
  std::uint32_t id = 0;  ///< Error class as in linux/can/error.h, as python-can writes it.
  std::uint16_t flags_ext = 0;
  std::uint16_t reserved2 = 0;
  std::array<std::uint8_t, 8> data{};
};
static_assert(sizeof(CanErrorExt) == 32);

struct CanFdMessage {
  std::uint16_t channel = 1;
  std::uint8_t flags = 0;
  std::uint8_t dlc = 0;
  std::uint32_t id = 0;
  std::uint32_t frame_length_ns = 0;
  std::uint8_t arbitration_bits = 0;
  std::uint8_t fd_flags = 0;  ///< 1: FD, 2: bit rate switch, 4: error state indicator.
  std::uint8_t length = 0;
  std::array<std::uint8_t, 5> reserved{};
  std::array<std::uint8_t, 64> data{};
};
static_assert(sizeof(CanFdMessage) == 84);

/// Its data bytes follow it, `length` of them.
struct CanFdMessage64 {
  std::uint8_t channel = 1;
  std::uint8_t dlc = 0;
  std::uint8_t length = 0;
  std::uint8_t tx_count = 0;
  std::uint32_t id = 0;
  std::uint32_t frame_length_ns = 0;
  std::uint32_t flags = 0;  ///< 0x10 remote, 0x1000 FD, 0x2000 bit rate switch, 0x4000 error state indicator.
  std::array<std::uint32_t, 4> timing{};
  std::uint16_t bit_count = 0;
  std::uint8_t direction = 0;  ///< 0 received.
  std::uint8_t ext_data_offset = 0;
  std::uint32_t crc = 0;
};
static_assert(sizeof(CanFdMessage64) == 40);

}  // namespace meltbench::log::blf
