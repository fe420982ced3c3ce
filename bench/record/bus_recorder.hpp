#pragma once
/// Writes down what goes over a CAN bus.

#include <cstdint>
#include <string>

#include "bench/record/log_files.hpp"
#include "bench/record/wire_recorder.hpp"
#include "protocols/link/can_link.hpp"

namespace meltbench::record {

struct BusRecorderRequest {
  std::string device;  ///< Name in the lines, e.g. "can0".
  /// CLOCK_REALTIME minus CLOCK_MONOTONIC when the recording began: one time base for all of it.
  Nanos epoch_offset{};
};

struct BusRecorderResult {
  std::uint64_t frames = 0;
  std::uint64_t dropped = 0;  ///< By the kernel, because they were read too late.
  std::uint64_t downs = 0;    ///< Times that the bus went away.
};

/// Gives the link's socket the largest receive buffer that this user may have. @returns its bytes.
std::size_t enlarge_receive_buffer(int socket);

/// candump text of a bus. Frames that the kernel dropped become a DROPCOUNT line as candump writes it, a bus that goes
/// away and comes back a comment.
class BusRecorder final : public WireRecorder {
 public:
  /// @param link, files  outlive it.
  BusRecorder(link::CanLink& link, LogFiles& files, BusRecorderRequest request);

  void watch(std::vector<pollfd>& watched) const override;
  void take() override;
  void flush() override { files_.flush(); }
  void finish(Nanos stopped_at) override;
  [[nodiscard]] const BusRecorderResult& result() const { return result_; }

 private:
  [[nodiscard]] bool take_one();
  void note_drops();
  void note_link(bool is_up);

  link::CanLink& link_;
  LogFiles& files_;
  BusRecorderRequest request_;
  BusRecorderResult result_;
  Instant at_{};
  int known_fd_ = -1;
  std::uint64_t kernel_count_ = 0;
  bool was_up_ = true;
  std::string line_;
};

}  // namespace meltbench::record
