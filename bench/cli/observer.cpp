#include "bench/cli/observer.hpp"

namespace meltbench::cli {
namespace {

constexpr std::uint64_t kRowsPerLook = 64;
constexpr Nanos kFlushPeriod = 1s;

}  // namespace

Observer::Observer(record::RunRecorder& recorder, decode::WireSignals* wire, Progress& progress)
    : recorder_{recorder},
      names_{recorder.recording().info.participants},
      wire_{wire},
      progress_{progress},
      next_flush_{recorder.recording().info.in_virtual_time() ? Instant::never() : Instant{kFlushPeriod}} {}

void Observer::on_frame(const can::StampedFrame& frame, std::size_t sender) {
  recorder_.frame(frame, static_cast<std::uint8_t>(sender));
  if (wire_ != nullptr) not_in_a_row_.push_back(frame);
}

void Observer::on_serial(std::string_view line, std::size_t sender, Instant at, std::span<const std::uint8_t> bytes) {
  recorder_.serial(line, name_of(sender), at, bytes);
}

void Observer::on_row(Instant at, std::span<const double> values) {
  recorder_.row(at, wire_ == nullptr ? values : append_wire(at, values));
  if (++rows_ % kRowsPerLook == 0) progress_.at(at);
  if (at < next_flush_) return;
  next_flush_ = at + kFlushPeriod;
  recorder_.flush();
}

void Observer::on_event(std::size_t participant, const Event& event) {
  recorder_.event(name_of(participant), event);
}

void Observer::on_join(std::string_view name) {
  names_.emplace_back(name);
}

std::string_view Observer::name_of(std::size_t participant) const {
  return participant < names_.size() ? std::string_view{names_[participant]} : "bench";
}

/// At wall-clock pace a row comes later than the frames of its instant.
std::span<const double> Observer::append_wire(Instant at, std::span<const double> values) {
  for (; !not_in_a_row_.empty() && not_in_a_row_.front().at <= at; not_in_a_row_.pop_front()) {
    wire_->on_frame(not_in_a_row_.front().frame);
  }
  row_.assign(values.begin(), values.end());
  row_.resize(values.size() + wire_->signals().size());
  wire_->read(std::span{row_}.subspan(values.size()));
  return row_;
}

}  // namespace meltbench::cli
