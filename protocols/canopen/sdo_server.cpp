#include "protocols/canopen/sdo_server.hpp"

#include <algorithm>

namespace meltbench::canopen {
namespace {}  // namespace

AbortCode DictionaryObjects::read(Instant /*now*/, ObjectAddress address, std::vector<std::uint8_t>& value) {
  const AbortCode code = dictionary_.check_read(address);
  if (code != AbortCode::kNone) return code;
  const auto bytes = dictionary_.at(address.index, address.sub).bytes();
  value.insert(value.end(), bytes.begin(), bytes.end());
  return AbortCode::kNone;
}

AbortCode DictionaryObjects::begin_write(ObjectAddress address, std::optional<std::size_t> size) {
  return dictionary_.check_write(address, size);
}

std::size_t DictionaryObjects::capacity(ObjectAddress address) {
  const OdEntry* const entry = dictionary_.find(address.index, address.sub);
  return entry == nullptr ? 0 : entry->capacity();
}

AbortCode DictionaryObjects::write(Instant /*now*/, ObjectAddress address, std::span<const std::uint8_t> value) {
  const AbortCode code = dictionary_.check_write(address, value);
  if (code == AbortCode::kNone) dictionary_.at(address.index, address.sub).assign(value);
  return code;
}

SdoServer::SdoServer(std::uint32_t request_id, std::uint32_t response_id, SdoObjects& objects, Nanos timeout)
    : request_id_{request_id}, response_id_{response_id}, objects_{objects}, timeout_{timeout} {}

void SdoServer::reset() {
  state_ = State::kIdle;
  address_ = {};
  buffer_.clear();
  give_up_at_ = deadline_ = Instant::never();
}

void SdoServer::abort(AbortCode code, Frames& out) {
  out.push_back(make_abort_frame(response_id_, address_, code));
  reset();
}

void SdoServer::expect_more(Instant now) {
  give_up_at_ = now + timeout_;
  // A block whose end got lost is acknowledged early, so that its sender can still repeat it in time.
  deadline_ = state_ == State::kBlockDownload ? now + timeout_ / 2 : give_up_at_;
}

void SdoServer::on_time(Instant now, Frames& out) {
  if (now < deadline_) return;
  if (now >= give_up_at_) return abort(AbortCode::kTimeout, out);
  if (state_ == State::kBlockDownload) {
    const Instant give_up_at = give_up_at_;  // Not moved: a silent client gets one early acknowledge, then the abort.
    acknowledge_block(now, out);
    give_up_at_ = deadline_ = give_up_at;
  }
}

void SdoServer::on_frame(Instant now, const can::CanFrame& frame, Frames& out) {
  if (!is_sdo_frame(frame, request_id_)) return;
  const Bytes bytes = frame.data();
  if (bytes[0] == 0x80) return reset();
  if (state_ == State::kBlockDownload) return on_block_segment(now, bytes, out);
  on_request(now, bytes, out);
}

void SdoServer::on_request(Instant now, Bytes frame, Frames& out) {
  switch (frame[0] >> 5) {
    case 0:
      return on_download_segment(now, frame, out);
    case 1:
      return initiate_download(now, frame, out);
    case 2:
      return initiate_upload(now, frame, out);
    case 3:
      return on_upload_segment(now, frame, out);
    case 5:
      if ((frame[0] & 0x03U) == 0) return initiate_block_upload(now, frame, out);
      return on_block_upload_request(now, frame, out);
    case 6:
      if ((frame[0] & 0x01U) == 0) return initiate_block_download(now, frame, out);
      return on_block_download_end(now, frame, out);
    default:
      if (state_ == State::kIdle) address_ = sdo_address(frame);
      return abort(AbortCode::kBadCommand, out);
  }
}

void SdoServer::initiate_download(Instant now, Bytes frame, Frames& out) {
  reset();
  address_ = sdo_address(frame);
  const bool expedited = (frame[0] & 0x02U) != 0;
  const bool size_given = (frame[0] & 0x01U) != 0;
  announced_size_.reset();
  if (expedited && size_given) announced_size_ = 4 - (frame[0] >> 2 & 0x03U);
  if (!expedited && size_given) announced_size_ = load<std::uint32_t>(frame, 4);
  const AbortCode code = objects_.begin_write(address_, announced_size_);
  if (code != AbortCode::kNone) return abort(code, out);
  capacity_ = objects_.capacity(address_);
  const can::CanFrame answer = make_sdo_frame(response_id_, 0x60, address_);
  if (expedited) {
    const std::size_t size = announced_size_.value_or(std::min<std::size_t>(4, capacity_));
    buffer_.assign(frame.begin() + 4, frame.begin() + 4 + static_cast<std::ptrdiff_t>(size));
    announced_size_ = size;
    return finish_download(now, answer, out);
  }
  toggle_ = 0;
  state_ = State::kDownload;
  expect_more(now);
  out.push_back(answer);
}

void SdoServer::on_download_segment(Instant now, Bytes frame, Frames& out) {
  if (state_ != State::kDownload) return abort(AbortCode::kBadCommand, out);
  if ((frame[0] & 0x10U) != toggle_) return abort(AbortCode::kToggle, out);
  const std::size_t size = kSegmentBytes - (frame[0] >> 1 & 0x07U);
  const std::size_t limit = announced_size_ ? std::min(capacity_, *announced_size_) : capacity_;
  if (buffer_.size() + size > limit) return abort(AbortCode::kTooLong, out);
  buffer_.insert(buffer_.end(), frame.begin() + 1, frame.begin() + 1 + static_cast<std::ptrdiff_t>(size));
  const can::CanFrame answer = make_sdo_frame(response_id_, static_cast<std::uint8_t>(0x20 | toggle_), {});
  if ((frame[0] & 0x01U) != 0) return finish_download(now, answer, out);
  toggle_ ^= 0x10;
  expect_more(now);
  out.push_back(answer);
}

void SdoServer::finish_download(Instant now, can::CanFrame answer, Frames& out) {
  if (announced_size_ && *announced_size_ != buffer_.size()) return abort(AbortCode::kLengthMismatch, out);
  const AbortCode code = objects_.write(now, address_, buffer_);
  if (code != AbortCode::kNone) return abort(code, out);
  out.push_back(answer);
  reset();
}

void SdoServer::initiate_upload(Instant now, Bytes frame, Frames& out) {
  reset();
  address_ = sdo_address(frame);
  const AbortCode code = objects_.read(now, address_, buffer_);
  if (code != AbortCode::kNone) return abort(code, out);
  answer_upload(now, out);
}

void SdoServer::answer_upload(Instant now, Frames& out) {
  const std::size_t size = buffer_.size();
  if (size >= 1 && size <= 4) {
    std::uint32_t data = 0;
    std::memcpy(&data, buffer_.data(), size);
    out.push_back(make_sdo_frame(response_id_, static_cast<std::uint8_t>(0x43 | (4 - size) << 2), address_, data));
    return reset();
  }
  out.push_back(make_sdo_frame(response_id_, 0x41, address_, static_cast<std::uint32_t>(size)));
  offset_ = 0;
  toggle_ = 0;
  state_ = State::kUpload;
  expect_more(now);
}

void SdoServer::on_upload_segment(Instant now, Bytes frame, Frames& out) {
  if (state_ != State::kUpload) return abort(AbortCode::kBadCommand, out);
  if ((frame[0] & 0x10U) != toggle_) return abort(AbortCode::kToggle, out);
  const std::size_t size = std::min(kSegmentBytes, buffer_.size() - offset_);
  const bool last = offset_ + size == buffer_.size();
  const auto command = static_cast<std::uint8_t>(toggle_ | (kSegmentBytes - size) << 1 | (last ? 1U : 0U));
  can::CanFrame answer = make_sdo_frame(response_id_, command, {});
  std::copy_n(buffer_.begin() + static_cast<std::ptrdiff_t>(offset_), size, answer.bytes.begin() + 1);
  out.push_back(answer);
  if (last) return reset();
  offset_ += size;
  toggle_ ^= 0x10;
  expect_more(now);
}

void SdoServer::initiate_block_download(Instant now, Bytes frame, Frames& out) {
  reset();
  address_ = sdo_address(frame);
  announced_size_.reset();
  if ((frame[0] & 0x02U) != 0) announced_size_ = load<std::uint32_t>(frame, 4);
  const AbortCode code = objects_.begin_write(address_, announced_size_);
  if (code != AbortCode::kNone) return abort(code, out);
  capacity_ = objects_.capacity(address_);
  use_crc_ = (frame[0] & 0x04U) != 0;
  receiver_.begin(kMaxBlockSize);
  state_ = State::kBlockDownload;
  expect_more(now);
  out.push_back(make_sdo_frame(response_id_, 0xA4, address_, kMaxBlockSize));
}

void SdoServer::on_block_segment(Instant now, Bytes frame, Frames& out) {
  const BlockReceiver::Outcome outcome = receiver_.on_segment(frame, buffer_);
  if (buffer_.size() >= capacity_ + kSegmentBytes) return abort(AbortCode::kTooLong, out);
  expect_more(now);
  if (outcome == BlockReceiver::Outcome::kBlockEnd) acknowledge_block(now, out);
}

void SdoServer::acknowledge_block(Instant now, Frames& out) {
  can::CanFrame answer = make_sdo_frame(response_id_, 0xA2, {});
  answer.bytes[1] = receiver_.acknowledged();
  answer.bytes[2] = receiver_.block_size();
  out.push_back(answer);
  if (receiver_.is_complete()) state_ = State::kBlockDownloadEnd;
  receiver_.begin_next_block();
  expect_more(now);
}

void SdoServer::on_block_download_end(Instant now, Bytes frame, Frames& out) {
  if (state_ != State::kBlockDownloadEnd) return abort(AbortCode::kBadCommand, out);
  buffer_.resize(buffer_.size() - (frame[0] >> 2 & 0x07U));
  if (use_crc_ && calc_crc16(buffer_) != load<std::uint16_t>(frame, 1)) return abort(AbortCode::kBadCrc, out);
  finish_download(now, make_sdo_frame(response_id_, 0xA1, {}), out);
}

void SdoServer::initiate_block_upload(Instant now, Bytes frame, Frames& out) {
  reset();
  address_ = sdo_address(frame);
  const AbortCode code = objects_.read(now, address_, buffer_);
  if (code != AbortCode::kNone) return abort(code, out);
  block_size_ = frame[4];
  if (block_size_ == 0 || block_size_ > kMaxBlockSize) return abort(AbortCode::kBadBlockSize, out);
  const std::uint8_t switch_threshold = frame[5];
  if (switch_threshold > 0 && buffer_.size() <= switch_threshold) return answer_upload(now, out);
  use_crc_ = (frame[0] & 0x04U) != 0;
  offset_ = 0;
  state_ = State::kBlockUploadStart;
  expect_more(now);
  out.push_back(make_sdo_frame(response_id_, 0xC6, address_, static_cast<std::uint32_t>(buffer_.size())));
}

void SdoServer::on_block_upload_request(Instant now, Bytes frame, Frames& out) {
  const std::uint8_t sub_command = frame[0] & 0x03U;
  if (state_ == State::kBlockUploadStart && sub_command == 3) return send_block(now, out);
  if (state_ == State::kBlockUploadEnd && sub_command == 1) return reset();
  if (state_ != State::kBlockUpload || sub_command != 2) return abort(AbortCode::kBadCommand, out);

  const std::uint8_t acknowledged = frame[1];
  block_size_ = frame[2];
  if (acknowledged > segments_sent_) return abort(AbortCode::kBadSequence, out);
  if (block_size_ == 0 || block_size_ > kMaxBlockSize) return abort(AbortCode::kBadBlockSize, out);
  offset_ += acknowledged * kSegmentBytes;
  const bool all_acknowledged = acknowledged > 0 && offset_ >= buffer_.size();
  if (!all_acknowledged) return send_block(now, out);

  state_ = State::kBlockUploadEnd;
  can::CanFrame end =
      make_sdo_frame(response_id_, static_cast<std::uint8_t>(0xC1 | count_unused_bytes(buffer_.size()) << 2), {});
  if (use_crc_) store(std::span{end.bytes}, 1, calc_crc16(buffer_));
  out.push_back(end);
  expect_more(now);
}

void SdoServer::send_block(Instant now, Frames& out) {
  segments_sent_ = append_block(response_id_, buffer_, offset_, block_size_, out);
  state_ = State::kBlockUpload;
  expect_more(now);
}

}  // namespace meltbench::canopen
