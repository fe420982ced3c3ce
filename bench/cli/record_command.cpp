#include "bench/cli/record_command.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <memory>
#include <stdexcept>

#include "bench/cli/version.hpp"
#include "bench/record/bus_recorder.hpp"
#include "bench/record/line_recorder.hpp"
#include "protocols/config/rig.hpp"
#include "protocols/config/toml.hpp"
#include "protocols/link/can_interface.hpp"
#include "protocols/link/clock.hpp"
#include "protocols/link/serial_link.hpp"
#include "protocols/runtime/bench_client.hpp"
#include "protocols/runtime/stop_signal.hpp"

namespace meltbench::cli {
namespace {

using Kind = link::BusUri::Kind;

/// A line to record, as the user has said it.
struct WantedLine {
  std::string name;
  std::string port;  ///< Empty: the embedded bus carries it.
  serial::LineSettings settings;
};

std::optional<config::Rig> read_rig_of(const std::filesystem::path& file, std::optional<config::Section>& root) {
  if (file.empty()) return std::nullopt;
  root.emplace(config::read_toml_file(file.string()));
  return config::read_rig(*root);
}

/// Takes "@BAUD_RATE" or "@BAUD_RATE:FORMAT" off a port's end. A name may have an '@' of its own.
bool take_settings(std::string& port, serial::LineSettings& settings) {
  const std::size_t at = port.rfind('@');
  if (at == std::string::npos) return false;
  const std::string_view words = std::string_view{port}.substr(at + 1);
  const std::size_t colon = std::min(words.find(':'), words.size());
  serial::LineSettings read = settings;
  const auto [end, error] = std::from_chars(words.data(), words.data() + colon, read.baud_rate);
  if (error != std::errc{} || end != words.data() + colon || read.baud_rate == 0) return false;
  if (colon < words.size()) {
    const auto with_format = serial::with_format(read, words.substr(colon + 1));
    if (!with_format) return false;
    read = *with_format;
  }
  settings = read;
  port.resize(at);
  return true;
}

std::vector<WantedLine> read_lines(const RecordRequest& request, const config::Rig* rig, bool on_embedded_bus) {
  std::vector<WantedLine> lines;
  for (const std::string& text : request.lines) {
    const std::size_t equals = std::min(text.find('='), text.size());
    WantedLine line{text.substr(0, equals), text.substr(std::min(equals + 1, text.size())), {}};
    const auto is_it = [&](const auto& other) { return other.name == line.name; };
    if (rig != nullptr) {
      const auto known = std::ranges::find_if(rig->lines, is_it);
      if (known != rig->lines.end()) line.settings = known->settings;
    }
    static_cast<void>(take_settings(line.port, line.settings));
    if (line.name.empty() || line.name.find_first_of(" \t\n") != std::string::npos ||
        (line.port.empty() && (equals < text.size() || !on_embedded_bus))) {
      throw std::invalid_argument{fmt::format(
          "a serial line is NAME=PORT, e.g. hopper=/dev/ttyUSB0@19200:8E1, or with virtual:BUS a NAME, not \"{}\"",
          text)};
    }
    if (std::ranges::any_of(lines, is_it)) {
      throw std::invalid_argument{fmt::format("serial line {} is given twice", line.name)};
    }
    lines.push_back(std::move(line));
  }
  return lines;
}

std::string bit_rate_text(const link::BusUri& uri, const config::Rig* rig) {
  if (uri.kind == Kind::kSlcan) return fmt::format("{} bit/s", uri.bit_rate_bit_per_s);
  const auto interfaces = link::list_can_interfaces();
  const auto own = std::ranges::find(interfaces, uri.name, &link::CanInterface::name);
  if (uri.kind == Kind::kSocketCan && own != interfaces.end() && own->bit_rate_bit_per_s) {
    std::string text = fmt::format("{} bit/s", *own->bit_rate_bit_per_s);
    if (own->data_bit_rate_bit_per_s) text += fmt::format(", data {} bit/s", *own->data_bit_rate_bit_per_s);
    return text;
  }
  const std::string by_rig = rig != nullptr ? fmt::format(", by the rig {} bit/s", rig->bus.bit_rate_bit_per_s) : "";
  return (uri.kind == Kind::kVirtual ? "as the bench has it" : "none, the interface is virtual") + by_rig;
}

/// Where a recording is from, and what its times are.
class Head {
 public:
  Head(const RecordRequest& request, const config::Rig* rig, Nanos started) {
    if (rig != nullptr) rig_ = fmt::format("# rig: {} ({})\n", rig->name, request.rig.string());
    time_ = fmt::format(
        "# time: seconds since 1970-01-01 UTC; the host's clock at the beginning, and its monotonic clock from then "
        "on\n"
        "# host's clock at the beginning: {:%Y-%m-%d %H:%M:%S}.{:06} UTC\n",
        fmt::gmtime(started / 1s), started % 1s / 1us);
  }
  [[nodiscard]] std::string of_bus(const std::string& name, const std::string& bit_rate) const {
    return fmt::format("# recording of {} by {}\n{}# bit rate: {}\n{}", name, kProgramVersion, rig_, bit_rate, time_);
  }
  [[nodiscard]] std::string of_lines(const std::vector<WantedLine>& lines) const {
    std::string text = fmt::format("# recording of serial lines by {}\n{}", kProgramVersion, rig_);
    for (const WantedLine& line : lines) {
      text += fmt::format("# line {} at {}: {} bit/s {}\n", line.name, line.port.empty() ? "the bench" : line.port,
                          line.settings.baud_rate, serial::write_format(line.settings));
    }
    return text + "# each line: (time of the last byte) line sender bytes\n" + time_;
  }

 private:
  std::string rig_;
  std::string time_;
};

record::LogFilesRequest request_files(const RecordRequest& request, std::filesystem::path file, std::string head) {
  record::LogFilesRequest files{std::move(file), std::move(head), {}, {}};
  if (request.rotate_MB) files.max_size = static_cast<std::uint64_t>(*request.rotate_MB * 1e6);
  if (request.rotate_min) files.max_age = nanos_from_s(*request.rotate_min * 60.0);
  return files;
}

/// Joins as one more program, that never sends.
std::unique_ptr<runtime::BenchClient> listen_to_bench(const std::string& bus, const std::vector<WantedLine>& lines) {
  runtime::Hello hello{fmt::format("recorder-{}", ::getpid()), true, {}, {}, {}};
  for (const WantedLine& line : lines) {
    if (line.port.empty()) hello.lines.push_back(line.name);
  }
  auto joined = runtime::join_bench(hello, bus);
  if (!joined && runtime::stop_requested()) throw link::LinkError{"told to stop before the bench let us listen", {}};
  if (!joined) {
    throw link::LinkError{fmt::format("the bench on virtual:{} lets nobody listen", bus),
                          hello.lines.empty() ? "it ended, or its frames go over a kernel bus: record that one"
                                              : "it ended, has no serial line of such a name, or its frames go over a "
                                                "kernel bus: record that one"};
  }
  if (joined->welcome.pace == link::Pace::kLockstep) {
    throw link::LinkError{"a run in virtual time cannot be recorded from outside", "it leaves its own bus.log"};
  }
  return std::make_unique<runtime::BenchClient>(std::move(joined->socket), hello.lines.size());
}

/// The wires, opened, and their recorders.
class Recording {
 public:
  Recording(const RecordRequest& request, const link::BusUri& uri, const config::Rig* rig)
      : has_bus_{uri.kind != Kind::kNone}, lines_{read_lines(request, rig, uri.kind == Kind::kVirtual)} {
    if (!has_bus_ && lines_.empty()) throw std::invalid_argument{"record needs a bus, or --line: nothing to record"};
    open_wires(uri);
    const Nanos started = link::read_clock(CLOCK_REALTIME);
    const Nanos epoch_offset = started - link::read_monotonic();
    const Head head{request, rig, started};
    const std::string device = uri.kind == Kind::kSlcan ? "slcan0" : has_bus_ ? uri.name : "serial";
    std::filesystem::path file = request.out;
    if (file.empty()) file = fmt::format("{}-{:%Y-%m-%d_%H%M%S}.log", device, fmt::gmtime(started / 1s));
    if (has_bus_) {
      bus_files_.emplace(request_files(request, file, head.of_bus(device, bit_rate_text(uri, rig))));
      bus_.emplace(can(), *bus_files_, record::BusRecorderRequest{device, epoch_offset});
      recorders_.push_back(&*bus_);
    }
    if (lines_.empty()) return;
    if (has_bus_) file.replace_extension(".serial" + file.extension().string());
    line_files_.emplace(request_files(request, file, head.of_lines(lines_)));
    heard_.emplace(list_heard(), *line_files_, epoch_offset);
    recorders_.push_back(&*heard_);
  }

  void tell_beginning() const {
    if (bus_files_) fmt::print("recording the bus to {}; Ctrl-C ends it\n", bus_files_->file().string());
    if (line_files_) fmt::print("recording serial lines to {}; Ctrl-C ends it\n", line_files_->file().string());
    std::fflush(stdout);
  }
  void run() {
    record::record_until(recorders_, [this] {
      return runtime::stop_requested() || (bench_ != nullptr && (bench_->stopped() || bench_->lost()));
    });
  }
  void tell_end() const {
    const auto files = [](const record::LogFiles& log) {
      return fmt::format("{} file{}", log.files(), log.files() == 1 ? "" : "s");
    };
    if (bus_) {
      const record::BusRecorderResult& result = bus_->result();
      fmt::print("{} frames in {}", result.frames, files(*bus_files_));
      if (bench_ == nullptr) {
        fmt::print(", {} dropped by the kernel; the bus was down {} times", result.dropped, result.downs);
      }
      fmt::print("\n");
    }
    if (heard_) {
      const record::LineRecorderResult& result = heard_->result();
      fmt::print("{} pieces of {} bytes in {}; a port was down {} times\n", result.pieces, result.bytes,
                 files(*line_files_), result.downs);
    }
    if (bench_ != nullptr && (bench_->stopped() || bench_->lost())) fmt::print("the run is over\n");
  }

 private:
  void open_wires(const link::BusUri& uri) {
    if (uri.kind == Kind::kVirtual) {
      bench_ = listen_to_bench(uri.name, lines_);
    } else {
      link_ = link::open_can_link(uri);
    }
    for (const WantedLine& line : lines_) {
      if (!line.port.empty()) ports_.push_back(std::make_unique<link::SerialPort>(line.port, line.settings));
    }
  }
  [[nodiscard]] link::CanLink& can() const { return bench_ != nullptr ? *bench_ : *link_; }
  [[nodiscard]] std::vector<record::HeardLine> list_heard() const {
    std::vector<record::HeardLine> heard;
    std::size_t port = 0;
    std::size_t of_bench = 0;
    for (const WantedLine& line : lines_) {
      link::SerialLink* link =
          line.port.empty() ? static_cast<link::SerialLink*>(&bench_->line(of_bench++)) : ports_[port++].get();
      heard.push_back({line.name, link, line.settings});
    }
    return heard;
  }

  bool has_bus_;
  std::vector<WantedLine> lines_;
  std::unique_ptr<runtime::BenchClient> bench_;  ///< Of an embedded bus; else null.
  std::unique_ptr<link::CanLink> link_;          ///< Else this one.
  std::vector<std::unique_ptr<link::SerialPort>> ports_;
  std::optional<record::LogFiles> bus_files_;
  std::optional<record::LogFiles> line_files_;
  std::optional<record::BusRecorder> bus_;
  std::optional<record::LineRecorder> heard_;
  std::vector<record::WireRecorder*> recorders_;
};

}  // namespace

ExitStatus record_log(const RecordRequest& request) {
  const link::BusUri uri = link::parse_bus_uri(request.can);
  std::optional<config::Section> root;
  const std::optional<config::Rig> rig = read_rig_of(request.rig, root);
  runtime::catch_stop_signals();
  Recording recording{request, uri, rig ? &*rig : nullptr};
  recording.tell_beginning();
  recording.run();
  recording.tell_end();
  return ExitStatus::kHeld;
}

}  // namespace meltbench::cli
