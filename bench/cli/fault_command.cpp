#include "bench/cli/fault_command.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <utility>

#include "protocols/link/bench_socket.hpp"
#include "protocols/runtime/bench_protocol.hpp"

namespace meltbench::cli {
namespace {

using runtime::Question;

constexpr Nanos kPatience = 2s;  // Of a bench to say who it is: one that runs looks every few milliseconds.
constexpr std::string_view kVirtual = "virtual:";

struct RunningBench {
  std::string bus;
  std::filesystem::path folder;
  std::string run;  ///< Its name.
};

/// @param timeout  zero: as long as the other end lives.
/// @returns nothing if there is none.
std::optional<runtime::Answer> ask(const std::string& bus, const Question& question, Nanos timeout) {
  link::BenchSocket socket{link::connect_embedded_bus(bus)};
  socket.set_timeout(timeout);
  link::MessageWriter writer;
  runtime::write_question(writer, question);
  if (!socket.send(writer.bytes())) return std::nullopt;
  std::span<const std::uint8_t> message;
  while (true) {
    const link::ReceiveStatus status = socket.receive(message);
    if (status == link::ReceiveStatus::kMessage) return runtime::read_answer(message);
    if (status != link::ReceiveStatus::kInterrupted) return std::nullopt;
  }
}

/// @returns nothing if nobody answers on that bus: its bench was killed, or is just ending.
std::optional<RunningBench> describe_bench(const std::string& bus) {
  try {
    const auto answer = ask(bus, {Question::About::kRun}, kPatience);
    if (!answer) return std::nullopt;
    const std::size_t cut = std::min(answer->text.find('\n'), answer->text.size());
    return RunningBench{bus, answer->text.substr(0, cut), answer->text.substr(std::min(cut + 1, answer->text.size()))};
  } catch (const link::LinkError&) {
    return std::nullopt;
  }
}

std::vector<RunningBench> find_benches(const std::vector<std::string>& buses) {
  std::vector<RunningBench> benches;
  for (const std::string& bus : buses) {
    if (auto bench = describe_bench(bus)) benches.push_back(std::move(*bench));
  }
  return benches;
}

std::string describe(const std::vector<RunningBench>& benches) {
  std::string text;
  for (const RunningBench& bench : benches) {
    text += fmt::format("\n  {}{:<24} {}, {}", kVirtual, bench.bus, bench.run, bench.folder.string());
  }
  return text;
}

/// @param name  of the bus, with or without "virtual:", or the run's folder; empty: the only bench that runs.
std::string choose_bus(std::string name) {
  if (name.starts_with(kVirtual)) name.erase(0, kVirtual.size());
  const std::vector<std::string> buses = link::list_embedded_buses();
  if (std::ranges::find(buses, name) != buses.end()) return name;  // Without asking the others, which may be slow.
  const std::vector<RunningBench> benches = find_benches(buses);
  if (benches.empty()) throw std::invalid_argument{"no bench is running; \"meltbench run\" starts one"};
  if (name.empty()) {
    if (benches.size() == 1) return benches.front().bus;
    throw std::invalid_argument{"several benches are running, say which: its bus or its folder" + describe(benches)};
  }
  const std::filesystem::path folder =
      (std::filesystem::absolute(name) / "").lexically_normal().parent_path();  // Without a slash at its end.
  const auto is_meant = [&](const RunningBench& bench) { return bench.bus == name || bench.folder == folder; };
  const auto found = std::ranges::find_if(benches, is_meant);
  if (found != benches.end()) return found->bus;
  throw std::invalid_argument{fmt::format("no bench \"{}\" is running; there are:{}", name, describe(benches))};
}

/// @throws std::invalid_argument for words too many or too few.
Question to_question(const FaultRequest& request, std::string& bench) {
  const bool gives = request.clear.empty() && !request.list;
  const std::size_t most = gives ? 2 : 1;
  if (request.words.size() > most) {
    throw std::invalid_argument{"too many words: put the fault between ' and '"};
  }
  if (gives && request.words.empty()) {
    throw std::invalid_argument{
        "which fault? e.g. 'target = \"frame\", kind = \"drop\", for_s = 1', or --list, or --clear"};
  }
  if (request.words.size() == most) bench = request.words.front();
  if (request.list) return {Question::About::kFaults};
  if (!gives) return {Question::About::kClearFault, request.clear};
  return {Question::About::kBeginFault, request.words.back()};
}

}  // namespace

ExitStatus give_fault(const FaultRequest& request) {
  std::string bench;
  const Question question = to_question(request, bench);
  const auto answer = ask(choose_bus(bench), question, Nanos{});
  if (!answer) {
    fmt::print(stderr, "error: the run has ended before it answered\n");
    return ExitStatus::kLost;
  }
  if (answer->accepted) {
    fmt::print("{}\n", answer->text);
    return ExitStatus::kHeld;
  }
  fmt::print(stderr, "error: {}\n", answer->text);
  if (!answer->hint.empty()) fmt::print(stderr, "hint: {}\n", answer->hint);
  return ExitStatus::kUsage;
}

}  // namespace meltbench::cli
