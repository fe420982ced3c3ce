#pragma once
/// A board on the desk: a process that does what the test says, and a master that speaks in raw frames.

#include <algorithm>
#include <array>
#include <fstream>
#include <functional>
#include <initializer_list>
#include <iterator>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "plant_emulator/board/board.hpp"
#include "plant_emulator/board/sampling.hpp"
#include "plant_emulator/model/barrel.hpp"
#include "protocols/canopen/eds.hpp"

namespace meltbench::board {

inline constexpr std::uint8_t kNode = 5;

/// Dictionary of fixtures/boards/NAME.eds for node 5.
inline canopen::ObjectDictionary read_board_eds(const std::string& name) {
  const std::string path = std::string{MELTBENCH_SOURCE_DIR} + "/fixtures/boards/" + name + ".eds";
  std::ifstream file{path};
  const std::string text{std::istreambuf_iterator<char>{file}, {}};
  return std::move(canopen::read_eds(text, path, kNode).dictionary);
}

/// Pressure is a function of time; the screw turns as commanded; every command is kept with its instant.
class FakeProcess final : public Process {
 public:
  std::function<double(double t_s)> pressure_at = [](double) { return 0.0; };
  std::vector<std::pair<Instant, double>> feeds_kg_per_s;
  std::vector<std::pair<Instant, double>> speeds_rev_per_s;
  std::function<double(double t_s)> front_at = [](double) { return kNothing; };
  std::function<double(double t_s)> T_inlet_at = [](double) { return kNothing; };
  std::function<double(double t_s)> T_melt_at = [](double) { return kNothing; };
  std::array<bool, 5> thermocouple_is_open{};
  std::array<double, 5> heater_share{};
  bool heater_supply = true;            // The contactor before them.
  std::optional<plant::Barrel> barrel;  // What the heaters heat, if the test has one.
  std::vector<std::pair<Instant, plant::MeltInlet>> inlets;
  plant::InletFlux flux;  // Its total is kept by advance_to().
  double turns_rev = 0;
  double speed_rev_per_s = 0;

  [[nodiscard]] double pressure_Pa() const override { return pressure_at(to_s(now_)); }
  [[nodiscard]] double encoder_rev() const override { return turns_rev; }
  [[nodiscard]] double encoder_rev_per_s() const override { return speed_rev_per_s; }
  void set_feed_kg_per_s(double feed) override { feeds_kg_per_s.emplace_back(now_, feed); }
  void set_screw_rev_per_s(double speed) override {
    speed_rev_per_s = speed;
    speeds_rev_per_s.emplace_back(now_, speed);
  }
  [[nodiscard]] double front_m() override { return front_at(to_s(now_)); }
  [[nodiscard]] double T_inlet_degC() override { return T_inlet_at(to_s(now_)); }
  [[nodiscard]] double T_melt_degC() override { return T_melt_at(to_s(now_)); }
  void set_inlet(const plant::MeltInlet& inlet) override {
    inlets.emplace_back(now_, inlet);
    flux.now_W_per_m2 = inlet.wanted_W_per_m2(T_inlet_degC());
  }
  [[nodiscard]] plant::InletFlux inlet_flux() const override { return flux; }
  [[nodiscard]] double T_zone_degC(std::size_t channel) const override {
    if (!barrel || channel >= barrel->zone_count() || thermocouple_is_open[channel]) return kNothing;
    return barrel->T_thermocouple_degC(channel);
  }
  void set_heater(std::size_t channel, double share) override {
    heater_share[channel] = share;
    if (barrel && channel < barrel->zone_count()) {
      barrel->set_heater_W(channel, share * barrel->parameters().zones[channel].max_power_W);
    }
  }
  void set_heater_supply(bool closed) override { heater_supply = closed; }
  void advance_to(Instant to) {
    if (barrel) barrel->advance(to_s(to - now_));
    flux.total_J_per_m2 += flux.now_W_per_m2 * to_s(to - now_);
    turns_rev += speed_rev_per_s * to_s(to - now_);
    now_ = to;
  }

 private:
  Instant now_{};
};

/// Serves one board the way the emulator does, and collects what it sends.
template <class Kind>
class BoardBench {
 public:
  template <class Settings>
  BoardBench(const std::string& eds, const Settings& settings, std::uint64_t seed = 1)
      : board{"board", read_board_eds(eds), kNode, settings, Chance{seed, "board"}, process} {}

  /// Power on at 0, and for convenience Operational.
  void start() {
    board.start(now, sent);
    run_to(now);
  }
  void start_operational() {
    start();
    send(0x000, {0x01, kNode});
    sent.clear();
  }

  void run_to(Instant to) {
    for (Instant due = board.next_deadline(); due <= to; due = board.next_deadline()) {
      advance(std::max(due, now));
      board.on_time(now, sent);
      advance(now);
    }
    advance(to);
    while (board.next_deadline() <= now) board.on_time(now, sent);
    board.settle(now);
  }

  void send(const can::CanFrame& frame) {
    board.on_frame(now, frame, sent);
    run_to(now);
  }
  void send(std::uint32_t id, std::initializer_list<std::uint8_t> data) { send(can::make_frame(id, data)); }
  void sync() { send(0x080, {}); }

  /// Expedited SDO. @returns the abort code, 0 = done.
  template <class T>
  std::uint32_t write(std::uint16_t index, std::uint8_t sub, T value) {
    can::CanFrame frame = request(static_cast<std::uint8_t>(0x23U | ((4U - sizeof(T)) << 2U)), index, sub);
    canopen::store(std::span{frame.bytes}, 4, value);
    return exchange(frame);
  }
  template <class T>
  T read(std::uint16_t index, std::uint8_t sub = 0) {
    if (exchange(request(0x40, index, sub)) != 0) throw std::runtime_error("SDO read refused");
    return canopen::load<T>(std::span<const std::uint8_t>{answer_.bytes}, 4);
  }

  /// Last frame with this identifier since sent was cleared.
  [[nodiscard]] std::optional<can::CanFrame> last(std::uint32_t id) const {
    for (auto frame = sent.rbegin(); frame != sent.rend(); ++frame) {
      if (frame->id == id) return *frame;
    }
    return std::nullopt;
  }
  [[nodiscard]] std::size_t count(std::uint32_t id) const {
    return static_cast<std::size_t>(
        std::count_if(sent.begin(), sent.end(), [&](const can::CanFrame& frame) { return frame.id == id; }));
  }

  FakeProcess process;
  Kind board;
  Instant now{};
  canopen::Frames sent;

 private:
  void advance(Instant to) {
    for (Instant touch = board.next_touch(to); touch <= to; touch = board.next_touch(to)) {
      process.advance_to(touch);
      board.touch(touch);
    }
    process.advance_to(to);
    now = to;
  }

  static can::CanFrame request(std::uint8_t command, std::uint16_t index, std::uint8_t sub) {
    return can::make_frame(0x600U + kNode, {command, static_cast<std::uint8_t>(index & 0xFFU),
                                            static_cast<std::uint8_t>(index >> 8U), sub, 0, 0, 0, 0});
  }
  std::uint32_t exchange(const can::CanFrame& frame) {
    canopen::Frames answers;
    board.on_frame(now, frame, answers);
    for (const can::CanFrame& answer : answers) {
      (answer.id == 0x580U + kNode ? answer_ : sent.emplace_back()) = answer;
    }
    run_to(now);
    return answer_.bytes[0] == 0x80 ? canopen::load<std::uint32_t>(std::span<const std::uint8_t>{answer_.bytes}, 4) : 0;
  }

  can::CanFrame answer_;
};

template <class T>
[[nodiscard]] T field(const can::CanFrame& frame, std::size_t at) {
  return canopen::load<T>(std::span<const std::uint8_t>{frame.bytes}, at);
}

}  // namespace meltbench::board
