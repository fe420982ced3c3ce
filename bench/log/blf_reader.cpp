#include "bench/log/blf_reader.hpp"

#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstring>

#include "bench/log/log_error.hpp"

namespace meltbench::log {
namespace {

constexpr std::size_t kAlignment = 4;
constexpr std::uint64_t kMaxStamp_ns = 1'000'000'000'000'000'000;  // Thirty years.
constexpr int kFirstPlausibleYear = 1990;

/// What the first bytes of `bytes` hold; zeros behind their end.
template <typename T>
T view(std::span<const char> bytes) {
  T value{};
  if (!bytes.empty()) std::memcpy(static_cast<void*>(&value), bytes.data(), std::min(bytes.size(), sizeof(T)));
  return value;
}

std::optional<Instant> to_instant(const blf::SystemTime& time) {
  const std::chrono::year_month_day date{std::chrono::year{time.year}, std::chrono::month{time.month},
                                         std::chrono::day{time.day}};
  if (time.year < kFirstPlausibleYear || time.year > 2200 || !date.ok()) return std::nullopt;
  return Instant{std::chrono::sys_days{date}.time_since_epoch() + std::chrono::hours{time.hour} +
                 std::chrono::minutes{time.minute} + std::chrono::seconds{time.second} +
                 std::chrono::milliseconds{time.milliseconds}};
}

}  // namespace

BlfReader::BlfReader(std::unique_ptr<ByteSource> source) : LogReader{LogFormat::kBlf, std::move(source)} {
  blf::FileHeader header;
  if (take_file_bytes(&header, sizeof header) != sizeof header) refuse("the file's header is cut off");
  if (header.signature != blf::FileHeader{}.signature || header.header_size < sizeof header ||
      !skip_file_bytes(header.header_size - sizeof header)) {
    refuse("the file's header is none");
  }
  start_ = to_instant(header.start).value_or(Instant{});
  file_size_ = header.file_size;
}

std::size_t BlfReader::take_file_bytes(void* to, std::size_t count) {
  std::size_t taken = 0;
  while (taken < count) {
    const std::size_t some = source_->read({static_cast<char*>(to) + taken, count - taken});
    if (some == 0) break;
    taken += some;
  }
  taken_ += taken;
  return taken;
}

bool BlfReader::skip_file_bytes(std::size_t count) {
  if (count > kMaxObject) return false;
  packed_.resize(count);
  return take_file_bytes(packed_.data(), count) == count;
}

bool BlfReader::read(LogEntry& entry) {
  for (;;) {
    const std::span<const char> rest = std::span{plain_}.subspan(next_);
    const auto header = view<blf::ObjectHeader>(rest);
    const bool has_header = rest.size() >= sizeof header;
    if (has_header && header.signature != blf::ObjectHeader{}.signature) refuse("an object was expected");
    if (has_header && (header.object_size < sizeof header || header.object_size > kMaxObject)) {
      refuse(fmt::format("an object of {} bytes", header.object_size));
    }
    if (!has_header || rest.size() < header.object_size) {
      if (load_container()) continue;
      if (!rest.empty()) warn("the last object is cut off; it is left out");
      return false;
    }
    ++objects_;
    const std::size_t padded = (header.object_size + kAlignment - 1) / kAlignment * kAlignment;
    next_ += std::min(padded, rest.size());
    if (read_object(rest.first(header.object_size), entry)) return true;
  }
}

/// Puts the next container behind what is left of the one before. @returns false at the end of the file.
bool BlfReader::load_container() {
  blf::ObjectHeader header;
  const std::size_t taken = take_file_bytes(&header, sizeof header);
  if (taken == 0) {
    if (taken_ < file_size_) warn(fmt::format("the file is cut off: {} of {} bytes are here", taken_, file_size_));
    return false;
  }
  if (taken < sizeof header) {
    warn("the last container is cut off; it is left out");
    return false;
  }
  if (header.signature != blf::ObjectHeader{}.signature || header.object_size < sizeof header ||
      header.object_size > kMaxObject) {
    refuse("a container was expected");
  }
  packed_.resize(header.object_size - sizeof header);
  if (take_file_bytes(packed_.data(), packed_.size()) != packed_.size()) {
    warn("the last container is cut off; it is left out");
    return false;
  }
  char padding[kAlignment];  // Writers pad to 4 with `size % 4` bytes, so with 0 to 3.
  if (header.object_size % kAlignment != 0)
    static_cast<void>(take_file_bytes(padding, header.object_size % kAlignment));
  plain_.erase(plain_.begin(), plain_.begin() + static_cast<std::ptrdiff_t>(next_));
  next_ = 0;
  if (header.type != blf::kContainer) return true;  // Not packed away: nothing that we know.
  const auto container = view<blf::ContainerHeader>(packed_);
  if (packed_.size() < sizeof container || container.unpacked_size > kMaxObject) refuse("a container of no size");
  unpack(container.packing, container.unpacked_size);
  return true;
}

/// Appends what packed_ holds behind its header to plain_.
void BlfReader::unpack(std::uint16_t packing, std::size_t unpacked_size) {
  const std::span<const char> content = std::span{packed_}.subspan(sizeof(blf::ContainerHeader));
  if (packing == 0) {
    plain_.insert(plain_.end(), content.begin(), content.end());
    return;
  }
  if (packing != 2) refuse(fmt::format("packing {} is not known", packing));
  const std::size_t before = plain_.size();
  plain_.resize(before + unpacked_size);
  uLongf size = unpacked_size;
  const int status = ::uncompress(reinterpret_cast<Bytef*>(plain_.data() + before), &size,
                                  reinterpret_cast<const Bytef*>(content.data()), content.size());
  if (status != Z_OK) refuse("a container cannot be unpacked");
  plain_.resize(before + size);
}

/// @returns false if the object is no CAN frame.
bool BlfReader::read_object(std::span<const char> object, LogEntry& entry) {
  const auto header = view<blf::ObjectHeader>(object);
  if (header.header_version != 1 && header.header_version != 2) return false;
  if (header.header_size < sizeof header + sizeof(blf::StampHeader) || header.header_size > object.size()) return false;
  const auto stamp = view<blf::StampHeader>(object.subspan(sizeof header));
  const std::uint64_t unit = stamp.flags == 1 ? 10'000 : 1;
  if (stamp.stamp > kMaxStamp_ns / unit) refuse("a time stamp beyond all measuring");
  entry = LogEntry{};
  entry.at = start_ + Nanos{static_cast<std::int64_t>(stamp.stamp * unit)};
  if (!read_frame(header.type, object.subspan(header.header_size), entry)) return false;
  if (!can::is_valid(entry.frame)) refuse("a frame that cannot exist on a bus");
  return true;
}

bool BlfReader::read_frame(std::uint32_t type, std::span<const char> body, LogEntry& entry) {
  can::CanFrame& frame = entry.frame;
  switch (type) {
    case blf::kCanMessage:
    case blf::kCanMessage2: {
      if (body.size() < sizeof(blf::CanMessage)) refuse("a frame without its data");
      const auto message = view<blf::CanMessage>(body);
      set_frame(entry, message.channel, message.id, (message.flags & blf::kSent) != 0);
      if ((message.flags & blf::kRemote) != 0) frame.kind = can::FrameKind::kRemote;
      frame.length = std::min<std::uint8_t>(message.dlc, can::kMaxClassicLength);
      if (message.dlc > can::kMaxClassicLength && message.dlc < 16) frame.raw_dlc = message.dlc;
      if (frame.kind == can::FrameKind::kData) std::copy_n(message.data.begin(), frame.length, frame.bytes.begin());
      return true;
    }
    case blf::kCanErrorExt: {
      if (body.size() < sizeof(blf::CanErrorExt)) refuse("an error frame without its data");
      const auto error = view<blf::CanErrorExt>(body);
      entry.channel = channel_number(fmt::format("{}", error.channel));
      frame.kind = can::FrameKind::kError;
      frame.id = error.id & can::kMaxExtendedId;
      frame.length = can::kMaxClassicLength;
      std::ranges::copy(error.data, frame.bytes.begin());
      return true;
    }
    case blf::kCanFdMessage: {
      const auto message = view<blf::CanFdMessage>(body);
      if (body.size() < offsetof(blf::CanFdMessage, data) + message.length) refuse("an FD frame without its data");
      set_frame(entry, message.channel, message.id, (message.flags & blf::kSent) != 0);
      frame.fd = (message.fd_flags & 1U) != 0;
      frame.brs = (message.fd_flags & 2U) != 0;
      frame.esi = (message.fd_flags & 4U) != 0;
      frame.length = std::min<std::uint8_t>(message.length, can::kMaxFdLength);
      std::copy_n(message.data.begin(), frame.length, frame.bytes.begin());
      return true;
    }
    case blf::kCanFdMessage64: {
      const auto message = view<blf::CanFdMessage64>(body);
      set_frame(entry, message.channel, message.id, message.direction != 0);
      frame.fd = (message.flags & 0x1000U) != 0;
      frame.brs = (message.flags & 0x2000U) != 0;
      frame.esi = (message.flags & 0x4000U) != 0;
      if ((message.flags & 0x10U) != 0) frame.kind = can::FrameKind::kRemote;
      const std::size_t room = body.size() - std::min(body.size(), sizeof message);
      if (message.length > room || message.length > can::kMaxFdLength) refuse("an FD frame without its data");
      frame.length = message.length;
      std::copy_n(body.begin() + sizeof message, message.length, frame.bytes.begin());
      return true;
    }
    default:
      return false;
  }
}

void BlfReader::set_frame(LogEntry& entry, unsigned channel, std::uint32_t id, bool sent) {
  entry.channel = channel_number(fmt::format("{}", channel));
  entry.direction = sent ? Direction::kSent : Direction::kReceived;
  entry.frame.extended = (id & blf::kExtendedId) != 0;
  entry.frame.id = id & ~blf::kExtendedId;
}

void BlfReader::refuse(std::string_view why) const {
  throw LogError{fmt::format("{}: object {}: {}", source_->name(), objects_ + 1, why), "is the BLF file damaged?"};
}

}  // namespace meltbench::log
