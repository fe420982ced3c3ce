#include "protocols/runtime/bench_client.hpp"

#include "protocols/runtime/real_time_clock.hpp"
#include "protocols/runtime/stop_signal.hpp"

namespace meltbench::runtime {

std::optional<JoinedBench> join_bench(const Hello& hello, const std::string& bus_name) {
  link::BenchSocket socket{link::connect_embedded_bus(bus_name)};
  link::MessageWriter writer;
  write_hello(writer, hello);
  if (!socket.send(writer.bytes())) return std::nullopt;
  std::span<const std::uint8_t> message;
  while (!stop_requested()) {
    const link::ReceiveStatus status = socket.receive(message);
    if (status == link::ReceiveStatus::kClosed) return std::nullopt;
    if (status != link::ReceiveStatus::kMessage) continue;
    if (message_type(message) == link::MessageType::kStop) return std::nullopt;
    if (const auto welcome = read_welcome(message)) return JoinedBench{std::move(socket), *welcome};
  }
  return std::nullopt;
}

std::size_t BenchLine::write(std::span<const std::uint8_t> bytes) noexcept {
  return client_.send_serial(number_, bytes) ? bytes.size() : 0;
}

std::optional<link::ReceivedBytes> BenchLine::receive() noexcept {
  const auto arrivals = arrived_.arrivals();
  if (read_ == arrivals.size()) {
    arrived_.clear();
    read_ = 0;
    return std::nullopt;
  }
  const SerialArrival& piece = arrivals[read_++];
  return link::ReceivedBytes{piece.at.since_start, piece.bytes};
}

bool BenchLine::is_up() const noexcept {
  return !client_.lost();
}

BenchClient::BenchClient(link::BenchSocket socket, std::size_t line_count) : socket_{std::move(socket)} {
  writer_.reserve(kUsualMessageSize);
  for (std::size_t number = 0; number < line_count; ++number) {
    lines_.push_back(std::make_unique<BenchLine>(*this, static_cast<std::uint8_t>(number)));
  }
}

bool BenchClient::send_serial(std::uint8_t line, std::span<const std::uint8_t> bytes) noexcept {
  write_serial_piece(writer_, {Instant{read_monotonic()}, line, bytes});
  const link::SendStatus status = socket_.try_send(writer_.bytes());
  if (status == link::SendStatus::kDown) lost_ = true;
  return status == link::SendStatus::kSent;
}

link::SendStatus BenchClient::send_as(std::uint8_t node, const can::CanFrame& frame) noexcept {
  write_frame(writer_, {read_monotonic(), node, frame});
  const link::SendStatus status = socket_.try_send(writer_.bytes());
  if (status == link::SendStatus::kFull) ++counters_.full;
  if (status == link::SendStatus::kDown) lost_ = true;
  return status;
}

std::optional<link::ReceivedFrame> BenchClient::receive() noexcept {
  std::span<const std::uint8_t> message;
  while (true) {
    const link::ReceiveStatus status = socket_.try_receive(message);
    if (status == link::ReceiveStatus::kClosed) lost_ = true;
    if (status != link::ReceiveStatus::kMessage) return std::nullopt;
    if (message_type(message) == link::MessageType::kStop) stopped_ = true;
    if (const auto carried = read_frame(message)) return link::ReceivedFrame{carried->at_monotonic, carried->frame};
    if (message_type(message) == link::MessageType::kNodes) nodes_told_ = read_node_states(message, node_states_);
    if (message_type(message) == link::MessageType::kLines) lines_told_ = read_line_states(message, line_states_);
    if (auto order = read_order(message)) orders_.push_back(std::move(*order));
    if (const auto piece = read_serial_piece(message); piece && piece->line < lines_.size()) {
      lines_[piece->line]->add(*piece);
    }
  }
}

void BenchClient::report(Instant at, std::span<const Event> events, std::span<const double> signals) noexcept {
  write_report(writer_, at, events, signals);
  if (socket_.try_send(writer_.bytes()) == link::SendStatus::kDown) lost_ = true;
}

void BenchClient::report_timing(const LogHistogram& lateness) noexcept {
  write_timing(writer_, lateness);
  if (socket_.try_send(writer_.bytes()) == link::SendStatus::kDown) lost_ = true;
}

void BenchClient::poll_stop() noexcept {
  while (receive()) {
  }
}

}  // namespace meltbench::runtime
