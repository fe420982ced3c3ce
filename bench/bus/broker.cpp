#include "bench/bus/broker.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <iterator>

#include "protocols/runtime/stop_signal.hpp"

namespace meltbench::bus {
namespace {

constexpr int kAcceptPoll_ms = 20;

}  // namespace

Broker::Broker(std::string bus_name, std::string about)
    : bus_name_{std::move(bus_name)}, listener_{link::listen_embedded_bus(bus_name_)}, about_{std::move(about)} {
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
    look();
    for (auto joined = came_.begin(); joined != came_.end();) {
      const auto place = static_cast<std::size_t>(std::ranges::find(names, joined->hello.name) - names.begin());
      const bool is_waited_for = place < names.size() && !found[place];
      if (is_waited_for) found[place] = std::move(*joined);
      joined = is_waited_for ? came_.erase(joined) : std::next(joined);
    }
  }
  std::vector<Joined> result;
  for (auto& joined : found) result.push_back(std::move(*joined));
  return result;
}

std::optional<Joined> Broker::take_newcomer() {
  if (came_.empty()) look();
  if (came_.empty()) return std::nullopt;
  Joined first = std::move(came_.front());
  came_.pop_front();
  return first;
}

std::optional<Asked> Broker::take_question() {
  if (asked_.empty()) look();
  if (asked_.empty()) return std::nullopt;
  Asked first = std::move(asked_.front());
  asked_.pop_front();
  return first;
}

void Broker::wait_for_news() const {
  std::vector<pollfd> watched{{listener_.get(), POLLIN, 0}};
  for (const link::BenchSocket& socket : silent_) watched.push_back({socket.fd(), POLLIN, 0});
  ::poll(watched.data(), watched.size(), kAcceptPoll_ms);
}

/// However long somebody takes from his connecting to his first word: on a busy machine that can be seconds.
void Broker::look() {
  if (silent_.size() < kMaxSilent) {
    link::UniqueFd connection{::accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC)};
    if (connection) silent_.emplace_back(std::move(connection));
  }
  for (auto socket = silent_.begin(); socket != silent_.end();) {
    std::span<const std::uint8_t> message;
    const link::ReceiveStatus status = socket->try_receive(message);
    if (status == link::ReceiveStatus::kTimeout || status == link::ReceiveStatus::kInterrupted) {
      ++socket;
      continue;
    }
    if (status == link::ReceiveStatus::kMessage) sort(std::move(*socket), message);
    socket = silent_.erase(socket);  // Closes, if nobody has taken it, and the other end sees that.
  }
}

void Broker::sort(link::BenchSocket socket, std::span<const std::uint8_t> message) {
  if (auto hello = runtime::read_hello(message)) {
    came_.push_back({std::move(*hello), std::move(socket)});
  } else if (auto question = runtime::read_question(message)) {
    const bool about_run = question->about == runtime::Question::About::kRun;
    asked_.push_back({std::move(*question), std::move(socket)});
    if (!about_run) return;
    answer(asked_.back(), {true, about_});
    asked_.pop_back();
  }
}

bool welcome(Joined& joined, const link::Welcome& welcome) {
  link::MessageWriter writer;
  runtime::write_welcome(writer, welcome);
  return joined.socket.send(writer.bytes());
}

void answer(Asked& asked, const runtime::Answer& answer) {
  link::MessageWriter writer;
  runtime::write_answer(writer, answer);
  static_cast<void>(asked.socket.try_send(writer.bytes()));
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
