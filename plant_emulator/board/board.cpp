#include "plant_emulator/board/board.hpp"

#include <stdexcept>

#include <fmt/format.h>

namespace meltbench::board {

canopen::ObjectDictionary with_defaults(const canopen::ObjectDictionary& dictionary,
                                        const std::vector<DefaultValue>& defaults) {
  for (const DefaultValue& value : defaults) static_cast<void>(dictionary.at(value.address.index, value.address.sub));
  canopen::ObjectDictionary copy;
  for (const auto& [address, entry] : dictionary.entries()) {
    canopen::EntryInfo info = entry.info();
    for (const DefaultValue& value : defaults) {
      if (value.address == address) info.default_value = value.bytes;
    }
    copy.add(std::move(info));
  }
  for (std::uint16_t type = 1; type <= 7; ++type) copy.allow_dummy(type, dictionary.is_dummy_allowed(type));
  return copy;
}

Board::Board(std::string name, canopen::ObjectDictionary dictionary, std::uint8_t node_id, Process& process)
    : Device{std::move(name), process}, node_{std::move(dictionary), node_id, this} {}

void Board::refresh_once(Instant now) {
  if (refreshed_at_ == now || hangs_) return;
  refresh(now);
  refreshed_at_ = now;
}

bool Board::carries(unsigned rpdo_number, canopen::ObjectAddress address) const {
  const auto index = static_cast<std::uint16_t>(0x1600U + rpdo_number - 1U);
  const canopen::ObjectDictionary& objects = node_.dictionary();
  const std::int64_t count = objects.integer_or(index, 0, 0);
  for (std::uint8_t sub = 1; sub <= count; ++sub) {
    const std::int64_t mapped = objects.integer_or(index, sub, 0) >> 8;  // Without the length in bits.
    if (mapped == ((std::int64_t{address.index} << 8) | address.sub)) return true;
  }
  return false;
}

canopen::AbortCode Board::on_read(Instant now, canopen::OdEntry& /*entry*/) {
  refresh_once(now);
  return canopen::AbortCode::kNone;
}

void Board::on_state(Instant now, canopen::NmtState /*from*/, canopen::NmtState to) {
  report(Severity::kInfo, now, "nmt-state", fmt::format("{}", text(to)));
}

}  // namespace meltbench::board
