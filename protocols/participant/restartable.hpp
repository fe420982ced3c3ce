#pragma once
/// A program that can end and be started anew in the middle of a run.

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/participant/participant.hpp"

namespace meltbench {

/// Is the program that it makes, until the bench orders kOrder: from then on it is another one of the same make, which
/// knows nothing of what was before. So a program in this process and one of its own are restarted in the same way.
/// Cost: a call per wake-up; a restart allocates.
class Restartable final : public Participant {
 public:
  using Make = std::function<std::unique_ptr<Participant>()>;
  static constexpr std::string_view kOrder = "program = \"restart\"\n";

  /// @param make  gives a new one each time, of the same name, nodes, lines and signals.
  explicit Restartable(Make make);

  [[nodiscard]] std::string_view name() const override { return name_; }
  [[nodiscard]] std::span<const std::string> nodes() const override { return nodes_; }
  [[nodiscard]] std::span<const std::string> lines() const override { return lines_; }
  void wake(const Wakeup& in, Outbox& out) override;
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return signals_; }
  void read_signals(std::span<double> values) const override { program_->read_signals(values); }

 private:
  Make make_;
  std::unique_ptr<Participant> program_;
  // Own copies: they outlive the program.
  std::string name_;
  std::vector<std::string> nodes_;
  std::vector<std::string> lines_;
  std::vector<SignalInfo> signals_;
};

}  // namespace meltbench
