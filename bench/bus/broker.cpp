#include "bench/bus/broker.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>

#include "protocols/runtime/stop_signal.hpp"

namespace meltbench::bus {
namespace {

constexpr int kAcceptPoll_ms = 20;

}  // namespace

Broker::Broker(std::string bus_name) : bus_name_{std::move(bus_name)}, listener_{link::listen_embedded_bus(bus_name_)} {
  ::fcntl(listener_.get(), F_SETFL, O_NONBLOCK);  // Who connects may be gone before he is taken.
}

Broker::~Broker() {
  link::remove_embedded_bus(bus_name_);
}

std::optional<std::vector<Joined>> Broker::wait_for(std::span<const std::string> names,
                                                    const std::function<bool()>& give_up) {
  std::vector<std::optional<Joined>> found(names.size());
  while (!std::ranges::all_of(found, [](const auto& joined) { return joined.has_value(); })) {
    if (give_up()) return std::nullopt;
    wait_for_news();
    auto joined = take_hello();
    if (!joined) continue;
    const auto place = static_cast<std::size_t>(std::ranges::find(names, joined->hello.name) - names.begin());
    if (place < names.size() && !found[place]) {
      found[place] = std::move(joined);
    } else {
      early_.push_back(std::move(*joined));
    }
  }
  std::vector<Joined> result;
  for (auto& joined : found) result.push_back(std::move(*joined));
  return result;
}

std::optional<Joined> Broker::take_newcomer() {
  if (early_.empty()) return take_hello();
  Joined first = std::move(early_.front());
  early_.pop_front();
  return first;
}

void Broker::wait_for_news() const {
  std::vector<pollfd> watched{{listener_.get(), POLLIN, 0}};
  for (const link::BenchSocket& socket : silent_) watched.push_back({socket.fd(), POLLIN, 0});
  ::poll(watched.data(), watched.size(), kAcceptPoll_ms);
}

/// However long a program takes from its connecting to its hello: on a busy machine that can be seconds.
std::optional<Joined> Broker::take_hello() {
  link::UniqueFd connection{::accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC)};
  if (connection) silent_.emplace_back(std::move(connection));
  for (auto socket = silent_.begin(); socket != silent_.end(); ++socket) {
    std::span<const std::uint8_t> message;
    const link::ReceiveStatus status = socket->try_receive(message);
    if (status == link::ReceiveStatus::kTimeout || status == link::ReceiveStatus::kInterrupted) continue;
    auto hello = status == link::ReceiveStatus::kMessage ? runtime::read_hello(message) : std::nullopt;
    link::BenchSocket said = std::move(*socket);
    silent_.erase(socket);
    if (!hello) return std::nullopt;  // Its socket closes here, and it sees that.
    return Joined{std::move(*hello), std::move(said)};
  }
  return std::nullopt;
}

bool welcome(Joined& joined, const link::Welcome& welcome) {
  link::MessageWriter writer;
  runtime::write_welcome(writer, welcome);
  return joined.socket.send(writer.bytes());
}

void stop(Joined& joined) {
  link::MessageWriter writer;
  writer.begin(link::MessageType::kStop);
  // Not send(): the other end may hang with a full queue. It then finds the socket closed.
  static_cast<void>(joined.socket.try_send(writer.bytes()));
}

SocketPort::SocketPort(Joined& joined) : joined_{joined} {
  joined_.socket.set_timeout(kWatchdog);
}

runtime::PortStatus SocketPort::wake(const Wakeup& in, Outbox& out, std::span<double> signals) {
  runtime::write_wake(writer_, in);
  if (!joined_.socket.send(writer_.bytes())) return runtime::PortStatus::kGone;
  std::span<const std::uint8_t> message;
  while (true) {
    switch (joined_.socket.receive(message)) {
      case link::ReceiveStatus::kMessage:
        if (runtime::stop_requested()) return runtime::PortStatus::kInterrupted;
        return runtime::read_done(message, out, signals) ? runtime::PortStatus::kOk : runtime::PortStatus::kNonsense;
      case link::ReceiveStatus::kTimeout:
        return runtime::PortStatus::kHanging;
      case link::ReceiveStatus::kClosed:
        return runtime::PortStatus::kGone;
      case link::ReceiveStatus::kInterrupted:
        if (runtime::stop_requested()) return runtime::PortStatus::kInterrupted;
    }
  }
}

}  // namespace meltbench::bus
