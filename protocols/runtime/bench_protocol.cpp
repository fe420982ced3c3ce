#include "protocols/runtime/bench_protocol.hpp"

namespace meltbench::runtime {
namespace {

using link::MessageReader;
using link::MessageType;
using link::MessageWriter;

void write_events(MessageWriter& writer, std::span<const Event> events) {
  writer.put(static_cast<std::uint32_t>(events.size()));
  for (const Event& event : events) {
    writer.put(event.at);
    writer.put(event.severity);
    writer.put_text(event.code);
    writer.put_text(event.text);
  }
}

/// Hands each event to `store`.
template <typename Store>
void read_events(MessageReader& reader, Store store) {
  const auto count = reader.take<std::uint32_t>();
  for (std::uint32_t i = 0; i < count && reader.ok(); ++i) {
    Event event;
    event.at = reader.take<Instant>();
    event.severity = reader.take<Severity>();
    event.code = reader.take_text();
    event.text = reader.take_text();
    if (reader.ok()) store(std::move(event));
  }
}

void write_texts(MessageWriter& writer, std::span<const std::string> texts) {
  writer.put(static_cast<std::uint32_t>(texts.size()));
  for (const std::string& text : texts) writer.put_text(text);
}

void read_texts(MessageReader& reader, std::vector<std::string>& texts) {
  texts.clear();
  const auto count = reader.take<std::uint32_t>();
  for (std::uint32_t i = 0; i < count && reader.ok(); ++i) texts.emplace_back(reader.take_text());
}

/// Values of one byte each.
template <typename T>
void write_states(MessageWriter& writer, std::span<const T> states) {
  writer.put(static_cast<std::uint32_t>(states.size()));
  for (const T state : states) writer.put(state);
}

template <typename T>
void read_states(MessageReader& reader, std::vector<T>& states) {
  states.clear();
  const auto count = reader.take<std::uint32_t>();
  for (std::uint32_t i = 0; i < count && reader.ok(); ++i) states.push_back(reader.take<T>());
}

std::span<const std::uint8_t> bytes_of(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

std::string_view text_of(std::span<const std::uint8_t> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

void write_serial(MessageWriter& writer, std::span<const SerialArrival> serial) {
  writer.put(static_cast<std::uint32_t>(serial.size()));
  for (const SerialArrival& arrival : serial) {
    writer.put(arrival.at);
    writer.put(arrival.line);
    writer.put_text(text_of(arrival.bytes));
  }
}

void read_serial(MessageReader& reader, std::vector<SerialArrival>& serial) {
  serial.clear();
  const auto count = reader.take<std::uint32_t>();
  for (std::uint32_t i = 0; i < count && reader.ok(); ++i) {
    const auto at = reader.take<Instant>();
    const auto line = reader.take<std::uint8_t>();
    serial.push_back({at, line, bytes_of(reader.take_text())});
  }
}

/// Frames in runs of one sender: node and count, then the frames.
void write_frames(MessageWriter& writer, const Outbox& out) {
  const auto marks = out.senders();
  const auto frames = out.frames();
  writer.put(static_cast<std::uint32_t>(marks.size() + 1));
  for (std::size_t run = 0; run <= marks.size(); ++run) {
    const std::size_t first = run == 0 ? 0 : marks[run - 1].first;
    const std::size_t end = run < marks.size() ? marks[run].first : frames.size();
    writer.put(run == 0 ? std::uint8_t{0} : marks[run - 1].node);
    writer.put(static_cast<std::uint32_t>(end - first));
    for (const can::CanFrame& frame : frames.subspan(first, end - first)) writer.put_frame(Instant{}, frame);
  }
}

void read_frames(MessageReader& reader, Outbox& out) {
  const auto runs = reader.take<std::uint32_t>();
  for (std::uint32_t run = 0; run < runs && reader.ok(); ++run) {
    out.speak_as(reader.take<std::uint8_t>());
    const auto count = reader.take<std::uint32_t>();
    for (std::uint32_t i = 0; i < count && reader.ok(); ++i) out.send(reader.take_frame().frame);
  }
}

void write_serial(MessageWriter& writer, const Outbox& out) {
  writer.put(static_cast<std::uint32_t>(out.serial().size()));
  for (const SerialPiece& piece : out.serial()) {
    writer.put(piece.line);
    writer.put_text(text_of(out.serial_bytes(piece)));
  }
}

void read_serial(MessageReader& reader, Outbox& out) {
  const auto pieces = reader.take<std::uint32_t>();
  for (std::uint32_t i = 0; i < pieces && reader.ok(); ++i) {
    const auto line = reader.take<std::uint8_t>();
    out.write(line, bytes_of(reader.take_text()));
  }
}

/// A reader behind the type byte; not ok() if the message is of another type.
std::optional<MessageReader> open(std::span<const std::uint8_t> message, MessageType type) {
  MessageReader reader{message};
  if (reader.take<MessageType>() != type || !reader.ok()) return std::nullopt;
  return reader;
}

}  // namespace

void write_hello(MessageWriter& writer, const Hello& hello) {
  writer.begin(MessageType::kHello);
  writer.put(link::kBenchProtocolVersion);
  writer.put_text(hello.name);
  writer.put(hello.carries_frames);
  writer.put(static_cast<std::uint32_t>(hello.signals.size()));
  for (const SignalInfo& signal : hello.signals) {
    writer.put_text(signal.name);
    writer.put(signal.kind);
  }
  write_texts(writer, hello.nodes);
  write_texts(writer, hello.lines);
}

std::optional<Hello> read_hello(std::span<const std::uint8_t> message) {
  auto reader = open(message, MessageType::kHello);
  if (!reader || reader->take<std::uint32_t>() != link::kBenchProtocolVersion) return std::nullopt;
  Hello hello;
  hello.name = reader->take_text();
  hello.carries_frames = reader->take<std::uint8_t>() != 0;
  const auto count = reader->take<std::uint32_t>();
  for (std::uint32_t i = 0; i < count && reader->ok(); ++i) {
    SignalInfo signal;
    signal.name = reader->take_text();
    signal.kind = reader->take<std::uint8_t>() == 0 ? SignalKind::kValue : SignalKind::kErrorCounter;
    hello.signals.push_back(std::move(signal));
  }
  read_texts(*reader, hello.nodes);
  read_texts(*reader, hello.lines);
  if (!reader->complete()) return std::nullopt;
  return hello;
}

void write_welcome(MessageWriter& writer, const link::Welcome& welcome) {
  writer.begin(MessageType::kWelcome);
  writer.put(welcome.pace);
  writer.put(welcome.speed);
  writer.put(welcome.start_monotonic);
  writer.put(welcome.record_period);
}

std::optional<link::Welcome> read_welcome(std::span<const std::uint8_t> message) {
  auto reader = open(message, MessageType::kWelcome);
  if (!reader) return std::nullopt;
  link::Welcome welcome;
  welcome.pace = reader->take<link::Pace>();
  welcome.speed = reader->take<double>();
  welcome.start_monotonic = reader->take<Nanos>();
  welcome.record_period = reader->take<Nanos>();
  if (!reader->complete()) return std::nullopt;
  return welcome;
}

std::optional<MessageType> message_type(std::span<const std::uint8_t> message) {
  if (message.empty()) return std::nullopt;
  return static_cast<MessageType>(message.front());
}

void write_wake(MessageWriter& writer, const Wakeup& in) {
  writer.begin(MessageType::kWake);
  writer.put(in.now);
  writer.put(in.link);
  writer.put(static_cast<std::uint32_t>(in.frames.size()));
  for (const can::StampedFrame& stamped : in.frames) writer.put_frame(stamped.at, stamped.frame);
  write_serial(writer, in.serial);
  write_states(writer, in.lines);
  write_states(writer, in.nodes);
  write_texts(writer, in.orders);
}

std::optional<Wakeup> read_wake(std::span<const std::uint8_t> message, WakeupStorage& storage) {
  auto reader = open(message, MessageType::kWake);
  if (!reader) return std::nullopt;
  Wakeup in;
  in.now = reader->take<Instant>();
  in.link = reader->take<LinkState>();
  const auto count = reader->take<std::uint32_t>();
  storage.frames.clear();
  for (std::uint32_t i = 0; i < count && reader->ok(); ++i) storage.frames.push_back(reader->take_frame());
  read_serial(*reader, storage.serial);
  read_states(*reader, storage.lines);
  read_states(*reader, storage.nodes);
  read_texts(*reader, storage.orders);
  if (!reader->complete()) return std::nullopt;
  in.frames = storage.frames;
  in.serial = storage.serial;
  in.lines = storage.lines;
  in.nodes = storage.nodes;
  in.orders = storage.orders;
  return in;
}

void write_done(MessageWriter& writer, const Outbox& out, std::span<const double> signals) {
  writer.begin(MessageType::kDone);
  writer.put(out.deadline());
  writer.put(out.wake_on());
  write_frames(writer, out);
  write_serial(writer, out);
  write_events(writer, out.events());
  writer.put_numbers(signals);
}

bool read_done(std::span<const std::uint8_t> message, Outbox& out, std::span<double> signals) {
  auto reader = open(message, MessageType::kDone);
  out.clear();
  if (!reader) return false;
  const auto deadline = reader->take<Instant>();
  const auto wake_on = reader->take<WakeOn>();
  out.wake_at(deadline, wake_on);
  read_frames(*reader, out);
  read_serial(*reader, out);
  read_events(*reader, [&out](Event event) {
    out.report(event.severity, event.at, std::move(event.code), std::move(event.text));
  });
  reader->take_numbers(signals);
  return reader->complete();
}

void write_report(MessageWriter& writer, Instant at, std::span<const Event> events, std::span<const double> signals) {
  writer.begin(MessageType::kReport);
  writer.put(at);
  write_events(writer, events);
  writer.put_numbers(signals);
}

std::optional<Instant> read_report(std::span<const std::uint8_t> message, std::vector<Event>& events,
                                   std::span<double> signals) {
  auto reader = open(message, MessageType::kReport);
  events.clear();
  if (!reader) return std::nullopt;
  const auto at = reader->take<Instant>();
  read_events(*reader, [&events](Event event) { events.push_back(std::move(event)); });
  reader->take_numbers(signals);
  if (!reader->complete()) return std::nullopt;
  return at;
}

void write_timing(MessageWriter& writer, const LogHistogram& lateness) {
  writer.begin(MessageType::kTiming);
  writer.put(lateness.max());
  writer.put(lateness.max_at());
  for (std::size_t bucket = 0; bucket < LogHistogram::kBuckets; ++bucket) {
    if (lateness.in_bucket(bucket) == 0) continue;
    writer.put(static_cast<std::uint16_t>(bucket));
    writer.put(lateness.in_bucket(bucket));
  }
}

bool read_timing(std::span<const std::uint8_t> message, LogHistogram& lateness) {
  auto reader = open(message, MessageType::kTiming);
  lateness = {};
  if (!reader) return false;
  const auto max = reader->take<Nanos>();
  lateness.set_max(max, reader->take<Instant>());
  while (reader->ok() && !reader->complete()) {
    const auto bucket = reader->take<std::uint16_t>();
    const auto count = reader->take<std::uint64_t>();
    if (!reader->ok() || bucket >= LogHistogram::kBuckets) return false;
    lateness.add_bucket(bucket, count);
  }
  return reader->complete();
}

void write_serial_piece(MessageWriter& writer, const SerialArrival& piece) {
  writer.begin(MessageType::kSerial);
  writer.put(piece.at);
  writer.put(piece.line);
  writer.put_text(text_of(piece.bytes));
}

std::optional<SerialArrival> read_serial_piece(std::span<const std::uint8_t> message) {
  auto reader = open(message, MessageType::kSerial);
  if (!reader) return std::nullopt;
  SerialArrival piece;
  piece.at = reader->take<Instant>();
  piece.line = reader->take<std::uint8_t>();
  piece.bytes = bytes_of(reader->take_text());
  if (!reader->complete()) return std::nullopt;
  return piece;
}

void write_frame(MessageWriter& writer, const CarriedFrame& carried) {
  writer.begin(MessageType::kFrames);
  writer.put(carried.node);
  writer.put_frame(Instant{carried.at_monotonic}, carried.frame);
}

std::optional<CarriedFrame> read_frame(std::span<const std::uint8_t> message) {
  auto reader = open(message, MessageType::kFrames);
  if (!reader) return std::nullopt;
  const auto node = reader->take<std::uint8_t>();
  const can::StampedFrame stamped = reader->take_frame();
  if (!reader->complete()) return std::nullopt;
  return CarriedFrame{stamped.at.since_start, node, stamped.frame};
}

void write_node_states(MessageWriter& writer, std::span<const can::ErrorState> states) {
  writer.begin(MessageType::kNodes);
  write_states(writer, states);
}

bool read_node_states(std::span<const std::uint8_t> message, std::vector<can::ErrorState>& states) {
  auto reader = open(message, MessageType::kNodes);
  if (!reader) return false;
  read_states(*reader, states);
  return reader->complete();
}

void write_line_states(MessageWriter& writer, std::span<const LinkState> states) {
  writer.begin(MessageType::kLines);
  write_states(writer, states);
}

bool read_line_states(std::span<const std::uint8_t> message, std::vector<LinkState>& states) {
  auto reader = open(message, MessageType::kLines);
  if (!reader) return false;
  read_states(*reader, states);
  return reader->complete();
}

void write_order(MessageWriter& writer, std::string_view text) {
  writer.begin(MessageType::kOrder);
  writer.put_text(text);
}

std::optional<std::string> read_order(std::span<const std::uint8_t> message) {
  auto reader = open(message, MessageType::kOrder);
  if (!reader) return std::nullopt;
  std::string text{reader->take_text()};
  if (!reader->complete()) return std::nullopt;
  return text;
}

void write_question(MessageWriter& writer, const Question& question) {
  writer.begin(MessageType::kQuestion);
  writer.put(link::kBenchProtocolVersion);
  writer.put(question.about);
  writer.put_text(question.text);
}

std::optional<Question> read_question(std::span<const std::uint8_t> message) {
  auto reader = open(message, MessageType::kQuestion);
  if (!reader || reader->take<std::uint32_t>() != link::kBenchProtocolVersion) return std::nullopt;
  const auto about = reader->take<std::uint8_t>();
  Question question{static_cast<Question::About>(about), std::string{reader->take_text()}};
  if (!reader->complete() || about > static_cast<std::uint8_t>(Question::About::kFaults)) return std::nullopt;
  return question;
}

void write_answer(MessageWriter& writer, const Answer& answer) {
  writer.begin(MessageType::kAnswer);
  writer.put(answer.accepted);
  writer.put_text(answer.text);
  writer.put_text(answer.hint);
}

std::optional<Answer> read_answer(std::span<const std::uint8_t> message) {
  auto reader = open(message, MessageType::kAnswer);
  if (!reader) return std::nullopt;
  Answer answer;
  answer.accepted = reader->take<std::uint8_t>() != 0;
  answer.text = reader->take_text();
  answer.hint = reader->take_text();
  if (!reader->complete()) return std::nullopt;
  return answer;
}

}  // namespace meltbench::runtime
