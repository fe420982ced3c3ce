#include "bench/record/bus_recorder.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>

#include "protocols/can/candump.hpp"
#include "protocols/link/clock.hpp"

namespace meltbench::record {
namespace {

constexpr int kReceiveBuffer = 32 << 20;  // Some 40,000 frames in the kernel's book-keeping: seconds of a full bus.
constexpr int kPoll_ms = 20;
constexpr int kBatch = 256;  // Frames between two looks at the clock, the link and whether to stop.

/// One recording; record_bus() is its loop.
class Recorder {
 public:
  Recorder(link::CanLink& link, LogFiles& files, const BusRecorderRequest& request)
      : link_{link}, files_{files}, request_{request}, flushed_at_{link::read_monotonic()} {}

  /// Takes one frame. @returns false if none waits.
  bool take_one() {
    const auto received = link_.receive();
    if (!received) return false;
    note_drops();
    // Stamps of different clocks can be a microsecond out of order; a log's time does not go back.
    at_ = std::max(at_, Instant{received->at_monotonic + request_.epoch_offset});
    line_.clear();
    can::append_log_line(line_, at_, request_.device, received->frame);
    files_.append(at_, line_);
    ++result_.frames;
    return true;
  }

  void flush_if_due() {
    const Nanos now = link::read_monotonic();
    if (now - flushed_at_ < kFlushEvery) return;
    files_.flush();
    flushed_at_ = now;
  }

  void note_link(bool is_up) {
    if (is_up == was_up_) return;
    was_up_ = is_up;
    if (!is_up) ++result_.downs;
    at_ = std::max(at_, Instant{link::read_monotonic() + request_.epoch_offset});
    files_.append(at_, fmt::format("# {:.6f} s: {} is {}\n", to_s(at_), request_.device, is_up ? "back" : "down"));
  }

  /// Takes what had come when it was told to stop; a bus that babbles never stops.
  BusRecorderResult finish() {
    const Instant stopped_at{link::read_monotonic() + request_.epoch_offset};
    while (at_ < stopped_at && take_one()) {
    }
    files_.flush();
    return result_;
  }

 private:
  /// The kernel counts from the opening of the socket.
  void note_drops() {
    const std::uint64_t count = link_.counters().dropped;
    if (count == kernel_count_) return;
    const std::uint64_t lost = count > kernel_count_ ? count - kernel_count_ : count;
    kernel_count_ = count;
    result_.dropped += lost;
    files_.append(at_, fmt::format("DROPCOUNT: dropped {} CAN frame{} on '{}' socket (total drops {})\n", lost,
                                   lost == 1 ? "" : "s", request_.device, result_.dropped));
  }

  link::CanLink& link_;
  LogFiles& files_;
  const BusRecorderRequest& request_;
  BusRecorderResult result_;
  Instant at_{};
  Nanos flushed_at_;
  std::uint64_t kernel_count_ = 0;
  bool was_up_ = true;
  std::string line_;
};

}  // namespace

std::size_t enlarge_receive_buffer(int socket) {
  const int wanted = kReceiveBuffer;
  if (::setsockopt(socket, SOL_SOCKET, SO_RCVBUFFORCE, &wanted, sizeof(wanted)) != 0) {
    (void)::setsockopt(socket, SOL_SOCKET, SO_RCVBUF, &wanted, sizeof(wanted));
  }
  int size = 0;
  socklen_t length = sizeof(size);
  if (::getsockopt(socket, SOL_SOCKET, SO_RCVBUF, &size, &length) != 0) return 0;
  return static_cast<std::size_t>(size);
}

BusRecorderResult record_bus(link::CanLink& link, LogFiles& files, const BusRecorderRequest& request,
                             const std::function<bool()>& stop) {
  Recorder recorder{link, files, request};
  int known_fd = link.fd();
  enlarge_receive_buffer(known_fd);
  while (!stop()) {
    pollfd wait{link.fd(), POLLIN, 0};
    (void)::poll(&wait, 1, kPoll_ms);  // A descriptor below 0 is passed over: then this only waits.
    for (int i = 0; i < kBatch && recorder.take_one(); ++i) {
    }
    recorder.note_link(link.is_up());
    if (link.fd() != known_fd) {
      known_fd = link.fd();
      if (known_fd >= 0) enlarge_receive_buffer(known_fd);
    }
    recorder.flush_if_due();
  }
  return recorder.finish();
}

}  // namespace meltbench::record
