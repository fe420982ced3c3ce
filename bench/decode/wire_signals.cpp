#include "bench/decode/wire_signals.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

namespace meltbench::decode {
namespace {

constexpr std::uint16_t kFirstOfDevice = 0x2000;  // Below are the objects of communication.

/// "wire.feeder.2001", "wire.heater.7130_2".
std::string make_name(std::string_view board, const canopen::EntryInfo& info) {
  const std::string index = fmt::format("wire.{}.{:04X}", board, info.address.index);
  return info.object_code == canopen::ObjectCode::kVar ? index : fmt::format("{}_{}", index, info.address.sub);
}

/// Everything that a PDO's mapping names, also one that is switched off.
std::vector<canopen::ObjectAddress> find_mapped(const BoardObjects& board) {
  std::vector<canopen::ObjectAddress> mapped;
  for (const FollowedPdo& followed : board.pdos()) {
    for (const MappedObject& object : followed.objects) mapped.push_back(object.entry->address());
  }
  return mapped;
}

}  // namespace

WireSignals::WireSignals(std::span<const config::RigBoard> boards, std::span<const std::string> wanted) {
  for (const config::RigBoard& board : boards) {
    if (!board.is_on_line()) add_columns(boards_.emplace_back(board), wanted);
  }
  values_.assign(signals_.size(), std::numeric_limits<double>::quiet_NaN());
}

void WireSignals::add_columns(const BoardObjects& board, std::span<const std::string> wanted) {
  const std::vector<canopen::ObjectAddress> mapped = find_mapped(board);
  for (const auto& [address, entry] : board.dictionary().entries()) {
    if (address.index < kFirstOfDevice || canopen::size_of(entry.info().type) == 0) continue;
    std::string name = make_name(board.name(), entry.info());
    const bool is_mapped = std::ranges::find(mapped, address) != mapped.end();
    const bool is_wanted = std::ranges::find(wanted, name) != wanted.end();
    if (!is_mapped && !is_wanted) continue;
    columns_.emplace(&entry, signals_.size());
    signals_.push_back({std::move(name), SignalKind::kValue});
  }
}

void WireSignals::on_frame(const can::CanFrame& frame) {
  if (frame.extended || frame.kind != can::FrameKind::kData) return;
  for (BoardObjects& board : boards_) {
    if (const auto change = board.follow(frame); change.written != nullptr) {
      set(*change.written, change.written->bytes());
    }
    for (const FollowedPdo& followed : board.pdos()) take_pdo(followed, frame);
  }
}

void WireSignals::take_pdo(const FollowedPdo& followed, const can::CanFrame& frame) {
  const canopen::Pdo& pdo = followed.pdo;
  if (!pdo.active || pdo.id != frame.id || pdo.extended || frame.length < pdo.mapping.length()) return;
  for (const MappedObject& object : followed.objects) {
    set(*object.entry, frame.data().subspan(object.first, object.size));
  }
}

void WireSignals::set(const canopen::OdEntry& entry, std::span<const std::uint8_t> bytes) {
  if (const auto column = columns_.find(&entry); column != columns_.end()) {
    values_[column->second] = to_number(entry, bytes);
  }
}

void WireSignals::read(std::span<double> values) const {
  std::ranges::copy(values_, values.begin());
}

}  // namespace meltbench::decode
