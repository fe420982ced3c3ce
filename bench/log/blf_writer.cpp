#include "bench/log/blf_writer.hpp"

#include <zlib.h>

#include <algorithm>
#include <chrono>

#include "bench/log/log_error.hpp"
#include "protocols/can/frame_bits.hpp"

namespace meltbench::log {
namespace {

constexpr std::size_t kContainerSize = 128 * 1024;
constexpr Instant kFirstDate{Nanos{631'152'000'000'000'000}};  // 1990: a stamp before it is no date.

template <typename T>
std::string_view bytes_of(const T& value) {
  return {reinterpret_cast<const char*>(&value), sizeof value};
}

blf::SystemTime to_system_time(Instant at) {
  if (at < kFirstDate) return {};
  const auto days = std::chrono::floor<std::chrono::days>(at.since_start);
  const std::chrono::sys_days day{days};
  const std::chrono::year_month_day date{day};
  const std::chrono::hh_mm_ss time{std::chrono::floor<std::chrono::milliseconds>(at.since_start - days)};
  const auto narrow = [](auto value) { return static_cast<std::uint16_t>(value); };
  return {narrow(static_cast<int>(date.year())),
          narrow(static_cast<unsigned>(date.month())),
          narrow(std::chrono::weekday{day}.c_encoding()),
          narrow(static_cast<unsigned>(date.day())),
          narrow(time.hours().count()),
          narrow(time.minutes().count()),
          narrow(time.seconds().count()),
          narrow(time.subseconds().count())};
}

}  // namespace

BlfWriter::BlfWriter(std::unique_ptr<ByteSink> sink) : sink_{std::move(sink)} {
  header_.unpacked_size = sizeof header_;
  write_bytes(bytes_of(header_));
}

void BlfWriter::write(const LogEntry& entry, std::string_view channel) {
  if (!begun_) {
    begun_ = true;
    if (entry.at >= kFirstDate) start_ = Instant{std::chrono::floor<std::chrono::milliseconds>(entry.at.since_start)};
    header_.start = to_system_time(start_);
  }
  header_.end = to_system_time(entry.at);
  const auto number = static_cast<std::uint16_t>(channels_.of(channel));
  const can::CanFrame& frame = entry.frame;
  if (frame.kind == can::FrameKind::kError) {
    blf::CanErrorExt error{.channel = number, .dlc = frame.length, .id = frame.id};
    std::copy_n(frame.bytes.begin(), error.data.size(), error.data.begin());
    append(entry.at, blf::kCanErrorExt, error);
  } else if (frame.fd) {
    append_fd(entry, number);
  } else {
    blf::CanMessage message;
    message.channel = number;
    if (entry.direction == Direction::kSent) message.flags |= blf::kSent;
    if (frame.kind == can::FrameKind::kRemote) message.flags |= blf::kRemote;
    message.dlc = static_cast<std::uint8_t>(can::data_length_code(frame));
    message.id = frame.id | (frame.extended ? blf::kExtendedId : 0);
    std::ranges::copy(frame.data(), message.data.begin());
    append(entry.at, blf::kCanMessage, message);
  }
}

void BlfWriter::append_fd(const LogEntry& entry, unsigned channel) {
  const can::CanFrame& frame = entry.frame;
  blf::CanFdMessage message;
  message.channel = static_cast<std::uint16_t>(channel);
  if (entry.direction == Direction::kSent) message.flags |= blf::kSent;
  message.dlc = can::to_fd_dlc(frame.length);
  message.id = frame.id | (frame.extended ? blf::kExtendedId : 0);
  message.fd_flags = static_cast<std::uint8_t>(1U | (frame.brs ? 2U : 0U) | (frame.esi ? 4U : 0U));
  message.length = frame.length;
  std::ranges::copy(frame.data(), message.data.begin());
  append(entry.at, blf::kCanFdMessage, message);
}

template <typename Object>
void BlfWriter::append(Instant at, std::uint32_t type, const Object& object) {
  static_assert(sizeof(Object) % 4 == 0, "objects begin at multiples of 4");
  blf::ObjectHeader header;
  header.header_size = sizeof(blf::ObjectHeader) + sizeof(blf::StampHeader);
  header.object_size = static_cast<std::uint32_t>(header.header_size + sizeof object);
  header.type = type;
  blf::StampHeader stamp;
  stamp.stamp = static_cast<std::uint64_t>(std::max((at - start_).count(), std::int64_t{0}));
  plain_.append(bytes_of(header)).append(bytes_of(stamp)).append(bytes_of(object));
  header_.unpacked_size += header.object_size;
  ++header_.object_count;
  while (plain_.size() >= kContainerSize) write_container(kContainerSize);
}

/// Writes the first `size` bytes of what waits as one container.
void BlfWriter::write_container(std::size_t size) {
  uLongf packed_size = ::compressBound(size);
  packed_.resize(packed_size);
  if (::compress(reinterpret_cast<Bytef*>(packed_.data()), &packed_size, reinterpret_cast<const Bytef*>(plain_.data()),
                 size) != Z_OK) {
    throw LogError{"zlib cannot pack a container", "is there memory?"};
  }
  packed_.resize(packed_size);
  plain_.erase(0, size);
  blf::ObjectHeader header;
  header.header_size = sizeof header;
  header.object_size = static_cast<std::uint32_t>(sizeof header + sizeof(blf::ContainerHeader) + packed_size);
  header.type = blf::kContainer;
  blf::ContainerHeader container;
  container.unpacked_size = static_cast<std::uint32_t>(size);
  header_.unpacked_size += sizeof header + sizeof container;
  write_bytes(bytes_of(header));
  write_bytes(bytes_of(container));
  write_bytes(packed_);
  write_bytes(std::string_view{"\0\0\0", 3}.substr(0, header.object_size % 4));
}

void BlfWriter::write_bytes(std::string_view bytes) {
  header_.file_size += bytes.size();
  sink_->write(bytes);
}

void BlfWriter::finish() {
  if (!plain_.empty()) write_container(plain_.size());
  sink_->rewrite_head(bytes_of(header_));
  sink_->close();
}

}  // namespace meltbench::log
