#include "controller/machine/serial_master.hpp"

#include <algorithm>

namespace meltbench::machine {

modbus::LineTiming timing_of(const ControllerSettings& settings, std::string_view line) {
  const auto found = std::find_if(settings.lines.begin(), settings.lines.end(),
                                  [&](const config::RigLine& each) { return each.name == line; });
  return modbus::make_line_timing(found->settings.baud_rate, serial::bits_per_character(found->settings));
}

void SerialMaster::on_bytes(Instant now, const SerialArrival& arrival) {
  client_.on_bytes(arrival.at, arrival.bytes);
  take_result(now);
}

void SerialMaster::on_time(Instant now, Outbox& out) {
  bytes_.clear();
  client_.on_time(now, bytes_);
  take_result(now);
  if (client_.is_idle()) {
    if (SerialDevice* device = find_due(now)) {
      asked_ = device;
      client_.send(now, device->unit(), device->make_request(now), bytes_);
    }
  }
  if (!bytes_.empty()) out.write(number_, bytes_);
}

void SerialMaster::take_result(Instant now) {
  if (const auto result = client_.take_result()) asked_->on_result(now, *result);
}

SerialDevice* SerialMaster::find_due(Instant now) const {
  const auto longest =
      std::min_element(devices_.begin(), devices_.end(), [](const SerialDevice* left, const SerialDevice* right) {
        return left->next_request_at() < right->next_request_at();
      });
  return longest != devices_.end() && (*longest)->next_request_at() <= now ? *longest : nullptr;
}

Instant SerialMaster::next_deadline() const {
  Instant next = client_.next_deadline();
  if (!client_.is_idle()) return next;
  for (const SerialDevice* device : devices_) next = std::min(next, device->next_request_at());
  return next;
}

}  // namespace meltbench::machine
