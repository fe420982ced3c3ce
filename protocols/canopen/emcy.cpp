#include "protocols/canopen/emcy.hpp"

#include <algorithm>

namespace meltbench::canopen {
namespace {

constexpr std::uint32_t kCobIdInvalid = 0x8000'0000;
// A node that may not speak for long keeps the newest messages.
constexpr std::size_t kMaxPending = 64;
constexpr std::size_t kMaxActive = 64;
constexpr std::uint8_t kMaxHistory = 254;

}  // namespace

can::CanFrame make_emcy(std::uint32_t id, const Emcy& emcy) {
  can::CanFrame frame;
  frame.id = id & can::kMaxExtendedId;
  frame.length = 8;
  store(std::span{frame.bytes}, 0, emcy.code);
  frame.bytes[2] = emcy.error_register;
  std::ranges::copy(emcy.manufacturer, frame.bytes.begin() + 3);
  return frame;
}

std::optional<ReceivedEmcy> parse_emcy(const can::CanFrame& frame) {
  const bool is_emcy_id = frame.id > cob_id::emcy(0) && frame.id <= cob_id::emcy(kMaxNodeId);
  if (!is_emcy_id || frame.kind != can::FrameKind::kData || frame.extended || frame.fd || frame.length != 8) return {};
  ReceivedEmcy received;
  received.node = static_cast<std::uint8_t>(frame.id - cob_id::emcy(0));
  received.emcy.code = load<std::uint16_t>(frame.bytes, 0);
  received.emcy.error_register = frame.bytes[2];
  std::copy_n(frame.bytes.begin() + 3, 5, received.emcy.manufacturer.begin());
  return received;
}

std::string_view emcy_text(std::uint16_t code) {
  switch (code) {
    case 0x8110:
      return "CAN overrun";
    case 0x8120:
      return "CAN error passive";
    case 0x8130:
      return "life guard or heartbeat error";
    case 0x8140:
      return "recovered from bus-off";
    case 0x8150:
      return "CAN identifier collision";
    case 0x8210:
      return "PDO not processed, too short";
    case 0x8220:
      return "PDO length exceeded";
    case 0x8230:
      return "destination of a multiplexed PDO not available";
    case 0x8240:
      return "unexpected SYNC data length";
    case 0x8250:
      return "RPDO timeout";
    default:
      break;
  }
  switch (code >> 8) {
    case 0x00:
      return "no error";
    case 0x10:
      return "generic error";
    case 0x20:
      return "current";
    case 0x21:
      return "current at the input";
    case 0x22:
      return "current inside the device";
    case 0x23:
      return "current at the output";
    case 0x30:
      return "voltage";
    case 0x31:
      return "mains voltage";
    case 0x32:
      return "voltage inside the device";
    case 0x33:
      return "output voltage";
    case 0x40:
      return "temperature";
    case 0x41:
      return "ambient temperature";
    case 0x42:
      return "device temperature";
    case 0x50:
      return "device hardware";
    case 0x60:
      return "device software";
    case 0x61:
      return "internal software";
    case 0x62:
      return "user software";
    case 0x63:
      return "data set";
    case 0x70:
      return "additional modules";
    case 0x80:
      return "monitoring";
    case 0x81:
      return "communication";
    case 0x82:
      return "protocol error";
    case 0x90:
      return "external error";
    case 0xF0:
      return "additional functions";
    case 0xFF:
      return "device specific";
    default:
      return "unknown error class";
  }
}

EmcyProducer::EmcyProducer(ObjectDictionary& dictionary)
    : register_{dictionary.find(0x1001, 0)}, cob_id_{dictionary.find(0x1014, 0)}, inhibit_{dictionary.find(0x1015, 0)} {
  for (std::uint8_t sub = 0; sub <= kMaxHistory; ++sub) {
    OdEntry* const entry = dictionary.find(0x1003, sub);
    if (entry == nullptr) break;
    history_.push_back(entry);
  }
  active_.reserve(kMaxActive);
  pending_.reserve(kMaxPending + 1);
  read_parameters();
}

void EmcyProducer::reset() {
  active_.clear();
  pending_.clear();
  next_allowed_ = {};
  clear_history();
  update_register();
  read_parameters();
}

void EmcyProducer::read_parameters() {
  inhibit_time_ = inhibit_ == nullptr ? Nanos{0} : 100us * inhibit_->to_int64();
}

bool EmcyProducer::is_active(std::uint16_t code) const {
  return std::ranges::find(active_, code, &Active::code) != active_.end();
}

bool EmcyProducer::raise(std::uint16_t code, std::uint8_t register_bits, const ManufacturerBytes& manufacturer) {
  const bool known =
      std::ranges::any_of(active_, [&](const Active& a) { return a.code == code && a.instance == manufacturer[0]; });
  if (known) return false;
  if (active_.size() == kMaxActive) active_.erase(active_.begin());
  active_.push_back({code, manufacturer[0], register_bits});
  update_register();
  push_history(code, manufacturer);
  queue({code, error_register_, manufacturer});
  return true;
}

bool EmcyProducer::clear(std::uint16_t code, std::optional<std::uint8_t> instance) {
  const auto cleared =
      std::erase_if(active_, [&](const Active& a) { return a.code == code && (!instance || a.instance == *instance); });
  if (cleared == 0) return false;
  update_register();
  queue({emcy_code::kNoError, error_register_, {}});
  return true;
}

void EmcyProducer::update_register() {
  error_register_ = 0;
  for (const Active& a : active_)
    error_register_ |= static_cast<std::uint8_t>(a.register_bits | error_register::kGeneric);
  if (register_ != nullptr) register_->set(error_register_);
}

void EmcyProducer::push_history(std::uint16_t code, const ManufacturerBytes& manufacturer) {
  if (history_.size() < 2) return;
  for (std::size_t i = history_.size() - 1; i > 1; --i) history_[i]->set(history_[i - 1]->get<std::uint32_t>());
  const std::uint32_t info = static_cast<std::uint32_t>(manufacturer[0] | manufacturer[1] << 8);
  history_[1]->set(static_cast<std::uint32_t>(code | info << 16));
  const auto depth = static_cast<std::uint8_t>(history_.size() - 1);
  history_[0]->set(static_cast<std::uint8_t>(std::min<unsigned>(depth, history_count() + 1U)));
}

void EmcyProducer::clear_history() {
  for (OdEntry* const entry : history_) {
    for (std::uint8_t& byte : entry->number_bytes()) byte = 0;
  }
}

std::uint8_t EmcyProducer::history_count() const {
  return history_.empty() ? 0 : history_[0]->get<std::uint8_t>();
}

void EmcyProducer::queue(const Emcy& emcy) {
  pending_.push_back(emcy);
  if (pending_.size() > kMaxPending) pending_.erase(pending_.begin());
}

Instant EmcyProducer::next_deadline() const {
  return pending_.empty() ? Instant::never() : next_allowed_;
}

void EmcyProducer::send_due(Instant now, Frames& out) {
  while (!pending_.empty() && now >= next_allowed_) {
    const std::uint32_t id = cob_id_ == nullptr ? kCobIdInvalid : static_cast<std::uint32_t>(cob_id_->to_int64());
    if ((id & kCobIdInvalid) == 0) {
      can::CanFrame frame = make_emcy(id, pending_.front());
      frame.extended = (id & 0x2000'0000U) != 0;
      out.push_back(frame);
      next_allowed_ = now + inhibit_time_;
    }
    pending_.erase(pending_.begin());
  }
}

}  // namespace meltbench::canopen
