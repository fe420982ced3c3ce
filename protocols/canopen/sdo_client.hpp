#pragma once
/// SDO client: reads and writes another node's dictionary, one transfer at a time.

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "protocols/canopen/sdo.hpp"

namespace meltbench::canopen {

enum class SdoMode : std::uint8_t {
  kPlain,  ///< Expedited up to 4 bytes, else segmented. Every server can do it.
  kBlock,  ///< Block transfer, with CRC if the server can.
};

enum class SdoStatus : std::uint8_t {
  kIdle,  ///< Nothing has been started.
  kBusy,
  kDone,
  kAborted,   ///< By the server, or by us because the server broke the protocol.
  kTimedOut,  ///< The server did not answer in time; it was told so with abort 0504 0000.
};

/// How the last transfer went.
struct SdoResult {
  SdoStatus status = SdoStatus::kIdle;
  ObjectAddress address;
  AbortCode abort_code = AbortCode::kNone;
  bool aborted_by_server = false;
  Nanos took{};                     ///< From the first request to the end.
  std::vector<std::uint8_t> value;  ///< What was written, or has been read.
};

/// "0x1018:1: aborted by the node with 06020000, object does not exist" and the like.
[[nodiscard]] std::string text(const SdoResult& result);

/// Talks to one server. After start_*() feed it frames and time until status() is not kBusy.
class SdoClient {
 public:
  /// @param server  node id 1..127 of the server; predefined COB-IDs.
  explicit SdoClient(std::uint8_t server, Nanos timeout = kDefaultSdoTimeout);

  /// Start a transfer. @pre not busy.
  void start_download(Instant now, ObjectAddress address, std::span<const std::uint8_t> value, Frames& out,
                      SdoMode mode = SdoMode::kPlain);
  void start_upload(Instant now, ObjectAddress address, Frames& out, SdoMode mode = SdoMode::kPlain);

  /// Ignores what is not an answer of its server to a running transfer.
  void on_frame(Instant now, const can::CanFrame& frame, Frames& out);
  void on_time(Instant now, Frames& out);
  [[nodiscard]] Instant next_deadline() const { return deadline_; }

  [[nodiscard]] SdoStatus status() const { return result_.status; }
  [[nodiscard]] const SdoResult& result() const { return result_; }
  [[nodiscard]] std::uint8_t server() const { return server_; }

  /// Gives a running transfer up, telling the server why.
  void cancel(Instant now, Frames& out, AbortCode why = AbortCode::kGeneral);

 private:
  enum class State : std::uint8_t {
    kIdle,
    kDownloadInitiated,
    kDownloadSegments,
    kUploadInitiated,
    kUploadSegments,
    kBlockDownloadInitiated,
    kBlockDownload,
    kBlockDownloadEnd,
    kBlockUploadInitiated,
    kBlockUpload,
    kBlockUploadEnd,
  };
  using Bytes = std::span<const std::uint8_t>;

  void begin(Instant now, ObjectAddress address, State state);
  void on_download_answer(Instant now, Bytes frame, Frames& out);
  void on_upload_initiated(Instant now, Bytes frame, Frames& out);
  void on_upload_segment(Instant now, Bytes frame, Frames& out);
  void on_block_download_initiated(Instant now, Bytes frame, Frames& out);
  void on_block_download_answer(Instant now, Bytes frame, Frames& out);
  void on_block_upload_initiated(Instant now, Bytes frame, Frames& out);
  void on_block_upload_segment(Instant now, Bytes frame, Frames& out);
  void on_block_upload_end(Instant now, Bytes frame, Frames& out);
  void send_download_segment(Frames& out);
  void request_upload_segment(Frames& out);
  void send_block(Frames& out);
  void acknowledge_block(Instant now, Frames& out);
  void expect_more(Instant now);
  void finish(Instant now, SdoStatus status, AbortCode code = AbortCode::kNone);
  void fail(Instant now, AbortCode code, Frames& out);
  void send(Frames& out, std::uint8_t command, std::uint32_t tail = 0);

  std::uint8_t server_;
  Nanos timeout_;
  State state_ = State::kIdle;
  SdoResult result_;
  Instant started_;
  std::optional<std::size_t> announced_size_;
  std::size_t offset_ = 0;
  std::uint8_t toggle_ = 0;
  bool use_crc_ = false;
  BlockReceiver receiver_;
  std::uint8_t block_size_ = 0;
  std::uint8_t segments_sent_ = 0;
  Instant give_up_at_ = Instant::never();
  Instant deadline_ = Instant::never();
};

}  // namespace meltbench::canopen
