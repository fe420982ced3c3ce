#pragma once
/// SDO server: lets one client read and write a dictionary, expedited, segmented or in blocks.

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "protocols/canopen/object_dictionary.hpp"
#include "protocols/canopen/sdo.hpp"

namespace meltbench::canopen {

/// What the server reads and writes. All answers are abort codes, kNone is success.
class SdoObjects {
 public:
  virtual ~SdoObjects() = default;

  /// Appends the value to `value` (empty on entry).
  virtual AbortCode read(Instant now, ObjectAddress address, std::vector<std::uint8_t>& value) = 0;

  /// May a download to this object begin? `size` if the client has said it.
  virtual AbortCode begin_write(ObjectAddress address, std::optional<std::size_t> size) = 0;

  /// Longest value that fits, and how many bytes a client means that sends an expedited value without its size.
  virtual std::size_t capacity(ObjectAddress address) = 0;

  virtual AbortCode write(Instant now, ObjectAddress address, std::span<const std::uint8_t> value) = 0;
};

/// A dictionary without behaviour behind an SDO server.
class DictionaryObjects final : public SdoObjects {
 public:
  explicit DictionaryObjects(ObjectDictionary& dictionary) : dictionary_{dictionary} {}
  AbortCode read(Instant now, ObjectAddress address, std::vector<std::uint8_t>& value) override;
  AbortCode begin_write(ObjectAddress address, std::optional<std::size_t> size) override;
  std::size_t capacity(ObjectAddress address) override;
  AbortCode write(Instant now, ObjectAddress address, std::span<const std::uint8_t> value) override;

 private:
  ObjectDictionary& dictionary_;
};

/// One transfer at a time; an initiate request that comes during one replaces it silently. Answers at once, in the same
/// instant. A client that falls silent is given up with abort 0504 0000 after the time-out; in a block download, what
/// has come is acknowledged after half of it, so that a lost last segment is repeated.
class SdoServer {
 public:
  /// @param request_id, response_id  COB-IDs, 0x600 + node and 0x580 + node.  @param objects  must outlive the server.
  SdoServer(std::uint32_t request_id, std::uint32_t response_id, SdoObjects& objects,
            Nanos timeout = kDefaultSdoTimeout);

  /// Ignores frames that are not SDO requests to it. Frames that make no sense are answered with an abort.
  void on_frame(Instant now, const can::CanFrame& frame, Frames& out);
  void on_time(Instant now, Frames& out);
  [[nodiscard]] Instant next_deadline() const { return deadline_; }
  [[nodiscard]] bool is_idle() const { return state_ == State::kIdle; }

  /// Forgets a running transfer without a word (NMT reset or stop).
  void reset();

 private:
  enum class State : std::uint8_t {
    kIdle,
    kDownload,
    kUpload,
    kBlockDownload,
    kBlockDownloadEnd,
    kBlockUploadStart,
    kBlockUpload,
    kBlockUploadEnd,
  };
  using Bytes = std::span<const std::uint8_t>;

  void on_request(Instant now, Bytes frame, Frames& out);
  void initiate_download(Instant now, Bytes frame, Frames& out);
  void initiate_upload(Instant now, Bytes frame, Frames& out);
  void initiate_block_download(Instant now, Bytes frame, Frames& out);
  void initiate_block_upload(Instant now, Bytes frame, Frames& out);
  void on_download_segment(Instant now, Bytes frame, Frames& out);
  void on_upload_segment(Instant now, Bytes frame, Frames& out);
  void on_block_segment(Instant now, Bytes frame, Frames& out);
  void on_block_download_end(Instant now, Bytes frame, Frames& out);
  void on_block_upload_request(Instant now, Bytes frame, Frames& out);
  void answer_upload(Instant now, Frames& out);
  void acknowledge_block(Instant now, Frames& out);
  void send_block(Instant now, Frames& out);
  void finish_download(Instant now, can::CanFrame answer, Frames& out);
  void expect_more(Instant now);
  void abort(AbortCode code, Frames& out);

  std::uint32_t request_id_;
  std::uint32_t response_id_;
  SdoObjects& objects_;
  Nanos timeout_;

  State state_ = State::kIdle;
  ObjectAddress address_;
  std::vector<std::uint8_t> buffer_;
  std::optional<std::size_t> announced_size_;
  std::size_t capacity_ = 0;
  std::size_t offset_ = 0;  // Of an upload: what has been acknowledged.
  std::uint8_t toggle_ = 0;
  bool use_crc_ = false;
  BlockReceiver receiver_;
  std::uint8_t block_size_ = 0;  // Of a block upload, as the client wants it.
  std::uint8_t segments_sent_ = 0;
  Instant give_up_at_ = Instant::never();
  Instant deadline_ = Instant::never();
};

}  // namespace meltbench::canopen
