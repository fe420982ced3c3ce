#pragma once

#include "protocols/can/frame_bits.hpp"

namespace meltbench::bus {

/// Reads a frame bit by bit as every node on the bus does, sender included: takes stuff bits out, checks form and check
/// sum. Errors that only a sender can see (bit, acknowledge) are not its business.
class FrameReader {
 public:
  enum class Verdict : std::uint8_t {
    kGoesOn,
    kStuffError,  ///< The sixth equal bit.
    kFormError,   ///< Dominant in a delimiter or in the first six bits of end of frame; a fixed stuff bit of FD.
    kCrcError,    ///< Told at the acknowledge delimiter, from where the error flag of a CRC error begins.
    kFrame,       ///< The seventh bit of end of frame has passed; the frame is valid whatever its level was.
  };

  /// Forgets the last frame; the next bit is a start of frame.
  void reset() { *this = FrameReader{}; }
  [[nodiscard]] Verdict push(bool recessive);

  /// Where the bit that was pushed last lies.
  [[nodiscard]] can::Field field() const { return field_; }
  /// True if the next bit is the acknowledge slot and the check sum was right.
  [[nodiscard]] bool acknowledges() const { return stage_ == Stage::kAck && !crc_wrong_; }
  /// What has been read. Complete after kFrame.
  [[nodiscard]] const can::CanFrame& frame() const { return frame_; }

 private:
  enum class Stage : std::uint8_t {
    kStart,
    kBase,
    kSubstitute,
    kIde,
    kExtension,
    kRemote,
    kFormat,
    kReserved,
    kFdReserved,
    kBrs,
    kEsi,
    kLength,
    kData,
    kCrc,
    kFdCrc,
    kCrcDelimiter,
    kAck,
    kAckDelimiter,
    kEnd,
  };

  [[nodiscard]] bool is_stuffed() const {
    return stage_ <= Stage::kCrc || (stage_ == Stage::kCrcDelimiter && !frame_.fd && run_ == 5);
  }
  void enter(Stage stage, unsigned bits);
  void take(bool recessive);
  void finish_stage();
  void finish_length();
  [[nodiscard]] can::Field locate() const;
  [[nodiscard]] Verdict push_fd_crc(bool recessive);
  [[nodiscard]] Verdict push_fixed(bool recessive);

  Stage stage_ = Stage::kStart;
  can::Field field_ = can::Field::kNone;
  unsigned left_ = 1;        // Bits of this stage still to come,
  std::uint32_t value_ = 0;  // and those that have come.
  bool last_ = true;
  unsigned run_ = 0;
  unsigned stuff_count_ = 0;
  bool remote_bit_ = false;
  bool bad_form_ = false;
  bool crc_wrong_ = false;
  can::Crc crc15_{can::Crc::Kind::k15};
  can::Crc crc17_{can::Crc::Kind::k17};
  can::Crc crc21_{can::Crc::Kind::k21};
  can::CanFrame frame_;
};

}  // namespace meltbench::bus
