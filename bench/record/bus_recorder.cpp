#include "bench/record/bus_recorder.hpp"

#include <fmt/format.h>
#include <sys/socket.h>

#include <algorithm>

#include "protocols/can/candump.hpp"
#include "protocols/link/clock.hpp"

namespace meltbench::record {
namespace {

constexpr int kReceiveBuffer = 32 << 20;  // Some 40,000 frames in the kernel's book-keeping: seconds of a full bus.
constexpr int kBatch = 256;               // Frames between two looks at the clock, the link and whether to stop.

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

BusRecorder::BusRecorder(link::CanLink& link, LogFiles& files, BusRecorderRequest request)
    : link_{link}, files_{files}, request_{std::move(request)}, known_fd_{link.fd()} {
  enlarge_receive_buffer(known_fd_);
}

void BusRecorder::watch(std::vector<pollfd>& watched) const {
  watched.push_back({link_.fd(), POLLIN, 0});  // A descriptor below 0 is passed over.
}

void BusRecorder::take() {
  for (int i = 0; i < kBatch && take_one(); ++i) {
  }
  note_link(link_.is_up());
  if (link_.fd() == known_fd_) return;
  known_fd_ = link_.fd();
  if (known_fd_ >= 0) enlarge_receive_buffer(known_fd_);
}

/// @returns false if none waits.
bool BusRecorder::take_one() {
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

/// The kernel counts from the opening of the socket.
void BusRecorder::note_drops() {
  const std::uint64_t count = link_.counters().dropped;
  if (count == kernel_count_) return;
  const std::uint64_t lost = count > kernel_count_ ? count - kernel_count_ : count;
  kernel_count_ = count;
  result_.dropped += lost;
  files_.append(at_, fmt::format("DROPCOUNT: dropped {} CAN frame{} on '{}' socket (total drops {})\n", lost,
                                 lost == 1 ? "" : "s", request_.device, result_.dropped));
}

void BusRecorder::note_link(bool is_up) {
  if (is_up == was_up_) return;
  was_up_ = is_up;
  if (!is_up) ++result_.downs;
  at_ = std::max(at_, Instant{link::read_monotonic() + request_.epoch_offset});
  files_.append(at_, fmt::format("# {:.6f} s: {} is {}\n", to_s(at_), request_.device, is_up ? "back" : "down"));
}

/// A bus that babbles never stops.
void BusRecorder::finish(Nanos stopped_at) {
  const Instant end{stopped_at + request_.epoch_offset};
  while (at_ < end && take_one()) {
  }
  files_.flush();
}

}  // namespace meltbench::record
