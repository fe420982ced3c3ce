#include "protocols/participant/restartable.hpp"

#include <array>
#include <catch2/catch.hpp>
#include <memory>

using namespace meltbench;

namespace {

/// Counts how often it has been woken.
class Counter final : public Participant {
 public:
  [[nodiscard]] std::string_view name() const override { return "counter"; }
  void wake(const Wakeup& /*in*/, Outbox& out) override {
    ++count_;
    out.send(can::make_frame(0x100, {count_}));
  }
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return signals_; }
  void read_signals(std::span<double> values) const override { values[0] = count_; }

 private:
  std::vector<SignalInfo> signals_{{"counter.count"}};
  std::uint8_t count_ = 0;
};

double wake(Restartable& program, std::span<const std::string> orders = {}) {
  Outbox out;
  program.wake({.now = Instant{}, .frames = {}, .orders = orders}, out);
  std::array<double, 1> values{};
  program.read_signals(values);
  CHECK(out.frames().size() == 1);
  return values[0];
}

}  // namespace

TEST_CASE("A restarted program knows nothing of what was before, and offers the same signals", "[participant]") {
  Restartable program{[] { return std::make_unique<Counter>(); }};
  const auto signals = program.signals();
  CHECK(wake(program) == 1);
  CHECK(wake(program) == 2);
  const std::array<std::string, 2> other{"target = \"feeder\"\n", "program = \"stop\"\n"};
  CHECK(wake(program, other) == 3);
  const std::array<std::string, 1> order{std::string{Restartable::kOrder}};
  CHECK(wake(program, order) == 1);
  CHECK(wake(program) == 2);
  REQUIRE(program.signals().size() == 1);
  CHECK(program.signals().data() == signals.data());
  CHECK(program.name() == "counter");
}
