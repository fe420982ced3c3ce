#pragma once
/// Writes down what a bit-timed bus tells, and asks the questions that its tests have.

#include <linux/can/error.h>

#include <string>
#include <vector>

#include "bench/bus/bit_timed_bus.hpp"
#include "protocols/can/candump.hpp"

namespace meltbench::test {

class BusLog final : public bus::BusListener {
 public:
  struct Error {
    Instant at;
    std::size_t node = 0;
    can::CanFrame frame;
  };
  struct State {
    Instant at;
    std::size_t node = 0;
    can::ErrorState state{};
    bool operator==(const State&) const = default;
  };

  void on_delivery(const bus::Delivery& delivery) override { deliveries.push_back(delivery); }
  void on_error(Instant at, std::size_t node, const can::CanFrame& error) override {
    errors.push_back({at, node, error});
  }
  void on_state(Instant at, std::size_t node, can::ErrorState state) override { states.push_back({at, node, state}); }

  /// "123@240us" of every frame, in the order of the wire.
  [[nodiscard]] std::string frames() const {
    std::string text;
    for (const bus::Delivery& d : deliveries) {
      if (!text.empty()) text += ' ';
      text += can::to_candump(d.frame).substr(0, can::to_candump(d.frame).find('#'));
    }
    return text;
  }
  /// Errors of one node on the bus, without reports of its state.
  [[nodiscard]] std::vector<Error> bus_errors(std::size_t node) const {
    std::vector<Error> found;
    for (const Error& error : errors) {
      if (error.node == node && (error.frame.id & CAN_ERR_BUSERROR) != 0) found.push_back(error);
    }
    return found;
  }

  std::vector<bus::Delivery> deliveries;
  std::vector<Error> errors;
  std::vector<State> states;
};

inline can::CanFrame frame(const char* text) {
  return *can::parse_candump(text);
}

}  // namespace meltbench::test
