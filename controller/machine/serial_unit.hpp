#pragma once
/// A Modbus unit under the controller's care: who it is, whether it is there, and what is wrong with it.

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "controller/machine/serial_master.hpp"
#include "controller/machine/settings.hpp"
#include "controller/machine/trouble.hpp"

namespace meltbench::machine {

/// Asked who it is, then what the derived class asks. No answer to a request and its repetitions: trouble device-lost,
/// once. It is asked on; when it answers again that is told (take_news()), and since it may have lost power, it is
/// configured anew; so is one that says itself that it has been reset (device-reset). Other troubles: boot-timeout,
/// identity-mismatch, configuration-failed (before it is ready), device-refused.
class SerialUnit : public SerialDevice {
 public:
  /// @param what  in messages, e.g. "feeder".
  SerialUnit(const ControllerSettings& settings, const BoardSettings& board, std::string_view what, std::uint8_t unit,
             std::string_view product_code);

  [[nodiscard]] std::uint8_t unit() const final { return unit_; }
  [[nodiscard]] Instant next_request_at() const final { return due_at_; }
  [[nodiscard]] modbus::Pdu make_request(Instant now) final;
  void on_result(Instant now, const modbus::ClientResult& result) final;

  /// It has been configured; once it was, it stays so here.
  [[nodiscard]] bool is_configured() const { return configured_; }
  [[nodiscard]] std::optional<Trouble> take_trouble();
  /// It is back after a trouble, told once.
  [[nodiscard]] std::optional<std::string> take_news();

 protected:
  /// The next request to a unit that is who it should be. It is asked again only after ask_at().
  [[nodiscard]] virtual modbus::Pdu make_own_request(Instant now) = 0;
  virtual void on_answer(Instant now, const modbus::ClientResult& result) = 0;
  /// It may have forgotten everything: its configuration begins anew.
  virtual void restart() = 0;

  /// @param what  is wrong, behind its name.
  void complain(std::string_view code, std::string_view what);
  /// It answers, and has lost its configuration.
  void note_reset(Instant now);
  void ask_at(Instant at) { due_at_ = at; }
  [[nodiscard]] bool is_asked() const { return due_at_ != Instant::never(); }
  [[nodiscard]] bool is_known() const { return known_; }  ///< It has said who it is.
  void mark_configured() { configured_ = true; }
  [[nodiscard]] const modbus::LineTiming& timing() const { return timing_; }

 private:
  void on_silence(Instant now, unsigned attempts);
  void identify(Instant now, const modbus::ClientResult& result);
  std::string label_;
  std::uint8_t unit_;
  std::string_view product_code_;
  modbus::LineTiming timing_;
  Nanos boot_timeout_;
  Instant due_at_{};
  std::optional<Instant> boot_until_;
  bool known_ = false;
  bool configured_ = false;
  bool lost_ = false;
  std::vector<Trouble> troubles_;
  std::optional<std::string> news_;
};

}  // namespace meltbench::machine
