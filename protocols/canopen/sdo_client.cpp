#include "protocols/canopen/sdo_client.hpp"

#include <algorithm>

#include <fmt/format.h>

namespace meltbench::canopen {
namespace {

// A server that never ends its answer is stopped here.
constexpr std::size_t kMaxUploadBytes = 1U << 20;

}  // namespace

std::string text(const SdoResult& result) {
  const std::string address = text(result.address);
  switch (result.status) {
    case SdoStatus::kIdle:
      return "no SDO transfer was started";
    case SdoStatus::kBusy:
      return fmt::format("{}: transfer is running", address);
    case SdoStatus::kDone:
      return fmt::format("{}: done in {} ms", address, to_s(result.took) * 1e3);
    case SdoStatus::kAborted:
      return fmt::format("{}: aborted by {} with {:08X}, {}", address, result.aborted_by_server ? "the node" : "us",
                         static_cast<std::uint32_t>(result.abort_code), text(result.abort_code));
    case SdoStatus::kTimedOut:
      return fmt::format("{}: no answer within {} ms", address, to_s(result.took) * 1e3);
  }
  return address;
}

SdoClient::SdoClient(std::uint8_t server, Nanos timeout) : server_{server}, timeout_{timeout} {}

void SdoClient::send(Frames& out, std::uint8_t command, std::uint32_t tail) {
  out.push_back(make_sdo_frame(cob_id::sdo_request(server_), command, result_.address, tail));
}

void SdoClient::begin(Instant now, ObjectAddress address, State state) {
  state_ = state;
  started_ = now;
  offset_ = 0;
  toggle_ = 0;
  announced_size_.reset();
  result_.status = SdoStatus::kBusy;
  result_.address = address;
  result_.abort_code = AbortCode::kNone;
  result_.aborted_by_server = false;
  result_.took = Nanos{0};
  expect_more(now);
}

void SdoClient::expect_more(Instant now) {
  give_up_at_ = now + timeout_;
  // The end of a block may have got lost: what has come is acknowledged early, so that the server repeats the rest.
  deadline_ = state_ == State::kBlockUpload ? now + timeout_ / 2 : give_up_at_;
}

void SdoClient::finish(Instant now, SdoStatus status, AbortCode code) {
  state_ = State::kIdle;
  give_up_at_ = deadline_ = Instant::never();
  result_.status = status;
  result_.abort_code = code;
  result_.took = now - started_;
}

void SdoClient::fail(Instant now, AbortCode code, Frames& out) {
  out.push_back(make_abort_frame(cob_id::sdo_request(server_), result_.address, code));
  finish(now, code == AbortCode::kTimeout ? SdoStatus::kTimedOut : SdoStatus::kAborted, code);
}

void SdoClient::cancel(Instant now, Frames& out, AbortCode why) {
  if (state_ != State::kIdle) fail(now, why, out);
}

void SdoClient::on_time(Instant now, Frames& out) {
  if (now < deadline_) return;
  if (now >= give_up_at_) return fail(now, AbortCode::kTimeout, out);
  if (state_ == State::kBlockUpload) {
    const Instant give_up_at = give_up_at_;  // Not moved: a silent server gets one early acknowledge, then the abort.
    acknowledge_block(now, out);
    give_up_at_ = deadline_ = give_up_at;
  }
}

void SdoClient::start_download(Instant now, ObjectAddress address, std::span<const std::uint8_t> value, Frames& out,
                               SdoMode mode) {
  begin(now, address, mode == SdoMode::kBlock ? State::kBlockDownloadInitiated : State::kDownloadInitiated);
  result_.value.assign(value.begin(), value.end());
  const auto size = static_cast<std::uint32_t>(value.size());
  if (mode == SdoMode::kBlock) return send(out, 0xC6, size);
  if (size == 0 || size > 4) return send(out, 0x21, size);
  std::uint32_t data = 0;
  std::memcpy(&data, value.data(), size);
  send(out, static_cast<std::uint8_t>(0x23 | (4 - size) << 2), data);
}

void SdoClient::start_upload(Instant now, ObjectAddress address, Frames& out, SdoMode mode) {
  begin(now, address, mode == SdoMode::kBlock ? State::kBlockUploadInitiated : State::kUploadInitiated);
  result_.value.clear();
  if (mode == SdoMode::kBlock) return send(out, 0xA4, kMaxBlockSize);
  send(out, 0x40);
}

void SdoClient::on_frame(Instant now, const can::CanFrame& frame, Frames& out) {
  if (state_ == State::kIdle || !is_sdo_frame(frame, cob_id::sdo_response(server_))) return;
  const Bytes bytes = frame.data();
  if (bytes[0] == 0x80) {
    result_.aborted_by_server = true;
    return finish(now, SdoStatus::kAborted, static_cast<AbortCode>(load<std::uint32_t>(bytes, 4)));
  }
  switch (state_) {
    case State::kIdle:
      return;
    case State::kDownloadInitiated:
    case State::kDownloadSegments:
      return on_download_answer(now, bytes, out);
    case State::kUploadInitiated:
      return on_upload_initiated(now, bytes, out);
    case State::kUploadSegments:
      return on_upload_segment(now, bytes, out);
    case State::kBlockDownloadInitiated:
      return on_block_download_initiated(now, bytes, out);
    case State::kBlockDownload:
    case State::kBlockDownloadEnd:
      return on_block_download_answer(now, bytes, out);
    case State::kBlockUploadInitiated:
      return on_block_upload_initiated(now, bytes, out);
    case State::kBlockUpload:
      return on_block_upload_segment(now, bytes, out);
    case State::kBlockUploadEnd:
      return on_block_upload_end(now, bytes, out);
  }
}

void SdoClient::on_download_answer(Instant now, Bytes frame, Frames& out) {
  const bool size_fits_expedited = !result_.value.empty() && result_.value.size() <= 4;
  if (state_ == State::kDownloadInitiated) {
    if (frame[0] != 0x60) return fail(now, AbortCode::kBadCommand, out);
    if (sdo_address(frame) != result_.address) return fail(now, AbortCode::kIncompatible, out);
    if (size_fits_expedited) return finish(now, SdoStatus::kDone);
    state_ = State::kDownloadSegments;
  } else {
    if ((frame[0] & 0xE0U) != 0x20) return fail(now, AbortCode::kBadCommand, out);
    if ((frame[0] & 0x10U) != toggle_) return fail(now, AbortCode::kToggle, out);
    if (offset_ == result_.value.size()) return finish(now, SdoStatus::kDone);
    toggle_ ^= 0x10;
  }
  send_download_segment(out);
  expect_more(now);
}

void SdoClient::send_download_segment(Frames& out) {
  const std::size_t size = std::min(kSegmentBytes, result_.value.size() - offset_);
  const bool last = offset_ + size == result_.value.size();
  const auto command = static_cast<std::uint8_t>(toggle_ | (kSegmentBytes - size) << 1 | (last ? 1U : 0U));
  can::CanFrame frame = make_sdo_frame(cob_id::sdo_request(server_), command, {});
  std::copy_n(result_.value.begin() + static_cast<std::ptrdiff_t>(offset_), size, frame.bytes.begin() + 1);
  out.push_back(frame);
  offset_ += size;
}

void SdoClient::on_upload_initiated(Instant now, Bytes frame, Frames& out) {
  if ((frame[0] & 0xE0U) != 0x40) return fail(now, AbortCode::kBadCommand, out);
  if (sdo_address(frame) != result_.address) return fail(now, AbortCode::kIncompatible, out);
  const bool expedited = (frame[0] & 0x02U) != 0;
  const bool size_given = (frame[0] & 0x01U) != 0;
  if (expedited) {
    const std::ptrdiff_t size = size_given ? 4 - (frame[0] >> 2 & 0x03) : 4;
    result_.value.assign(frame.begin() + 4, frame.begin() + 4 + size);
    return finish(now, SdoStatus::kDone);
  }
  if (size_given) announced_size_ = load<std::uint32_t>(frame, 4);
  state_ = State::kUploadSegments;
  request_upload_segment(out);
  expect_more(now);
}

void SdoClient::request_upload_segment(Frames& out) {
  out.push_back(make_sdo_frame(cob_id::sdo_request(server_), static_cast<std::uint8_t>(0x60 | toggle_), {}));
}

void SdoClient::on_upload_segment(Instant now, Bytes frame, Frames& out) {
  if ((frame[0] & 0xE0U) != 0x00) return fail(now, AbortCode::kBadCommand, out);
  if ((frame[0] & 0x10U) != toggle_) return fail(now, AbortCode::kToggle, out);
  const std::ptrdiff_t size = 7 - (frame[0] >> 1 & 0x07);
  result_.value.insert(result_.value.end(), frame.begin() + 1, frame.begin() + 1 + size);
  if (result_.value.size() > kMaxUploadBytes) return fail(now, AbortCode::kOutOfMemory, out);
  if ((frame[0] & 0x01U) != 0) {
    if (announced_size_ && *announced_size_ != result_.value.size()) return fail(now, AbortCode::kLengthMismatch, out);
    return finish(now, SdoStatus::kDone);
  }
  toggle_ ^= 0x10;
  request_upload_segment(out);
  expect_more(now);
}

void SdoClient::on_block_download_initiated(Instant now, Bytes frame, Frames& out) {
  if ((frame[0] & 0xE3U) != 0xA0) return fail(now, AbortCode::kBadCommand, out);
  if (sdo_address(frame) != result_.address) return fail(now, AbortCode::kIncompatible, out);
  use_crc_ = (frame[0] & 0x04U) != 0;
  block_size_ = frame[4];
  if (block_size_ == 0 || block_size_ > kMaxBlockSize) return fail(now, AbortCode::kBadBlockSize, out);
  state_ = State::kBlockDownload;
  send_block(out);
  expect_more(now);
}

void SdoClient::send_block(Frames& out) {
  segments_sent_ = append_block(cob_id::sdo_request(server_), result_.value, offset_, block_size_, out);
}

void SdoClient::on_block_download_answer(Instant now, Bytes frame, Frames& out) {
  if (state_ == State::kBlockDownloadEnd) {
    if (frame[0] != 0xA1) return fail(now, AbortCode::kBadCommand, out);
    return finish(now, SdoStatus::kDone);
  }
  if (frame[0] != 0xA2) return fail(now, AbortCode::kBadCommand, out);
  const std::uint8_t acknowledged = frame[1];
  block_size_ = frame[2];
  if (acknowledged > segments_sent_) return fail(now, AbortCode::kBadSequence, out);
  if (block_size_ == 0 || block_size_ > kMaxBlockSize) return fail(now, AbortCode::kBadBlockSize, out);
  offset_ += acknowledged * kSegmentBytes;
  const bool all_acknowledged = acknowledged > 0 && offset_ >= result_.value.size();
  if (all_acknowledged) {
    const auto command = static_cast<std::uint8_t>(0xC1 | count_unused_bytes(result_.value.size()) << 2);
    can::CanFrame end = make_sdo_frame(cob_id::sdo_request(server_), command, {});
    if (use_crc_) store(std::span{end.bytes}, 1, calc_crc16(result_.value));
    out.push_back(end);
    state_ = State::kBlockDownloadEnd;
  } else {
    send_block(out);
  }
  expect_more(now);
}

void SdoClient::on_block_upload_initiated(Instant now, Bytes frame, Frames& out) {
  if ((frame[0] & 0xE0U) == 0x40) {  // The server prefers a plain upload.
    state_ = State::kUploadInitiated;
    return on_upload_initiated(now, frame, out);
  }
  if ((frame[0] & 0xE1U) != 0xC0) return fail(now, AbortCode::kBadCommand, out);
  if (sdo_address(frame) != result_.address) return fail(now, AbortCode::kIncompatible, out);
  use_crc_ = (frame[0] & 0x04U) != 0;
  if ((frame[0] & 0x02U) != 0) announced_size_ = load<std::uint32_t>(frame, 4);
  receiver_.begin(kMaxBlockSize);
  state_ = State::kBlockUpload;
  send(out, 0xA3);
  expect_more(now);
}

void SdoClient::on_block_upload_segment(Instant now, Bytes frame, Frames& out) {
  const BlockReceiver::Outcome outcome = receiver_.on_segment(frame, result_.value);
  if (result_.value.size() > kMaxUploadBytes) return fail(now, AbortCode::kOutOfMemory, out);
  expect_more(now);
  if (outcome == BlockReceiver::Outcome::kBlockEnd) acknowledge_block(now, out);
}

void SdoClient::acknowledge_block(Instant now, Frames& out) {
  can::CanFrame frame = make_sdo_frame(cob_id::sdo_request(server_), 0xA2, {});
  frame.bytes[1] = receiver_.acknowledged();
  frame.bytes[2] = receiver_.block_size();
  out.push_back(frame);
  if (receiver_.is_complete()) state_ = State::kBlockUploadEnd;
  receiver_.begin_next_block();
  expect_more(now);
}

void SdoClient::on_block_upload_end(Instant now, Bytes frame, Frames& out) {
  if ((frame[0] & 0xE3U) != 0xC1) return fail(now, AbortCode::kBadCommand, out);
  result_.value.resize(result_.value.size() - (frame[0] >> 2 & 0x07U));
  if (use_crc_ && calc_crc16(result_.value) != load<std::uint16_t>(frame, 1)) return fail(now, AbortCode::kBadCrc, out);
  if (announced_size_ && *announced_size_ != result_.value.size()) return fail(now, AbortCode::kLengthMismatch, out);
  out.push_back(make_sdo_frame(cob_id::sdo_request(server_), 0xA1, {}));
  finish(now, SdoStatus::kDone);
}

}  // namespace meltbench::canopen
