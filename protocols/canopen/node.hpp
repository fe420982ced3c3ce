#pragma once
/// A CANopen node: everything of CiA 301 that a slave device does, around the dictionary of its EDS.

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "protocols/canopen/emcy.hpp"
#include "protocols/canopen/heartbeat.hpp"
#include "protocols/canopen/object_dictionary.hpp"
#include "protocols/canopen/parameter_store.hpp"
#include "protocols/canopen/pdo.hpp"
#include "protocols/canopen/sdo_server.hpp"
#include "protocols/canopen/types.hpp"

namespace meltbench::canopen {

enum class ResetKind : std::uint8_t { kPowerOn, kNode, kCommunication };

/// The application behind a node is told here what happens on the bus; all are called from inside Node::start, on_frame
/// or on_time, in the order of things. It may set dictionary values and call Node::event, raise_emcy, clear_emcy from
/// here; what that sends goes out before the node's call returns. Every default does nothing.
class NodeListener {
 public:
  virtual ~NodeListener() = default;

  /// SDO write, after all generic checks and before the value is stored. Anything but kNone refuses it.
  virtual AbortCode on_write(Instant /*now*/, const OdEntry& /*entry*/, std::span<const std::uint8_t> /*value*/) {
    return AbortCode::kNone;
  }
  /// The value has been stored.
  virtual void on_written(Instant /*now*/, const OdEntry& /*entry*/) {}

  /// SDO read: the last moment to refresh a value that is computed only when asked for.
  virtual AbortCode on_read(Instant /*now*/, OdEntry& /*entry*/) { return AbortCode::kNone; }

  /// SYNC received or produced, in Pre-operational or Operational; before the synchronous TPDOs of this SYNC are built
  /// and after the synchronous RPDOs before it were applied. @param counter  0 if the SYNC has none.
  virtual void on_sync(Instant /*now*/, std::uint8_t /*counter*/) {}

  /// RPDO `number` (from 1) is in the dictionary: as it came (asynchronous) or at this SYNC. Its values have not been
  /// compared with the objects' limits: the device decides what an impossible set point means (a REAL32 may be NaN).
  virtual void on_rpdo(Instant /*now*/, unsigned /*number*/) {}

  /// RPDO `number` has not come within its event timer.
  virtual void on_rpdo_timeout(Instant /*now*/, unsigned /*number*/) {}

  /// TPDO `number` is about to be built.
  virtual void before_tpdo(Instant /*now*/, unsigned /*number*/) {}

  virtual void on_state(Instant /*now*/, NmtState /*from*/, NmtState /*to*/) {}

  /// The dictionary holds stored or default values again: all writable ones, or only 0x1000..0x1FFF for kCommunication.
  /// Comes before the boot-up message.
  virtual void on_reset(Instant /*now*/, ResetKind /*kind*/) {}

  /// A node of 0x1016 was heard first, lost, came back, was reset or changed its state.
  virtual void on_heartbeat(Instant /*now*/, const HeartbeatEvent& /*event*/) {}

  /// 0x1010 or 0x1011 has changed Node::parameters(): the time to keep its image.
  virtual void on_stored(Instant /*now*/) {}
};

/// One node. No I/O, no clock: told frames and time, it answers with frames.
///
/// | state           | answers                                                                        |
/// |-----------------|--------------------------------------------------------------------------------|
/// | Initialising    | nothing; lasts from power-on or reset to the boot-up message, no virtual time  |
/// | Pre-operational | NMT, SDO, SYNC, EMCY, heartbeat and guarding                                   |
/// | Operational     | the same and PDOs                                                              |
/// | Stopped         | NMT, heartbeat and guarding; EMCYs wait                                        |
///
/// Objects with behaviour, where the dictionary has them: 0x1001, 1003, 1005, 1006, 1007, 100C, 100D, 1010, 1011,
/// 1014..1017, 1019, 1029:1, 14xx, 16xx, 18xx, 1Axx, 1F80 (bit 2 clear: goes Operational by itself). Transmission types
/// 252 and 253 are refused. All answers come in the same instant. Real time: no allocation in the steady state but for
/// SDO values longer than any before; a frame for somebody else costs a table look-up.
class Node final : private SdoObjects {
 public:
  /// @param dictionary  with the node's objects, as read_eds() gives them.
  /// @param listener    may be nullptr; must outlive the node.
  /// @throws std::invalid_argument if the node id is not 1..127 or the dictionary's PDO values do not fit together.
  Node(ObjectDictionary dictionary, std::uint8_t node_id, NodeListener* listener = nullptr);
  Node(const Node&) = delete;
  Node& operator=(const Node&) = delete;

  /// Power on: stored or default values, boot-up message, Pre-operational.
  void start(Instant now, Frames& out);

  void on_frame(Instant now, const can::CanFrame& frame, Frames& out);

  /// Does what is due at `now`, and sends what the application has asked for since the last call.
  void on_time(Instant now, Frames& out);

  /// When on_time() must be called next; not after `now` if the application has asked for something to be sent.
  [[nodiscard]] Instant next_deadline() const { return deadline_; }

  /// Asks for an event-driven TPDO (254, 255: as soon as its inhibit time allows; 0: at the next SYNC). Nothing happens
  /// outside Operational or for another type. @param number  from 1.
  void event(unsigned number);

  /// See EmcyProducer::raise and clear. The message goes out with the next on_time().
  void raise_emcy(std::uint16_t code, std::uint8_t register_bits, const ManufacturerBytes& manufacturer = {});
  void clear_emcy(std::uint16_t code, std::optional<std::uint8_t> instance = {});

  /// Changes the NMT state from inside, as 0x1029 asks for device profile errors. @pre not to kInitialising.
  void set_state(Instant now, NmtState state);

  [[nodiscard]] NmtState state() const { return state_; }
  [[nodiscard]] std::uint8_t node_id() const { return node_id_; }
  [[nodiscard]] ObjectDictionary& dictionary() { return dictionary_; }
  [[nodiscard]] const ObjectDictionary& dictionary() const { return dictionary_; }
  [[nodiscard]] const EmcyProducer& emcy() const { return emcy_; }
  [[nodiscard]] const HeartbeatConsumer& heartbeats() const { return heartbeats_; }
  [[nodiscard]] bool is_tpdo_active(unsigned number) const;

  /// Non-volatile memory. Load an image before start().
  [[nodiscard]] ParameterStore& parameters() { return parameters_; }

 private:
  // What a standard identifier means to this node, as bits of a table: one look-up refuses the frames of others.
  enum Interest : std::uint8_t { kNmt = 1, kSync = 2, kSdo = 4, kRpdo = 8, kHeartbeat = 16, kGuard = 32, kRemote = 64 };

  struct Rpdo : Pdo {
    std::array<std::uint8_t, 8> waiting{};  // Came, and waits for SYNC.
    bool is_waiting = false;
    Instant expires = Instant::never();
  };
  struct Tpdo : Pdo {
    bool event_pending = false;
    Instant not_before{};
    Instant timer = Instant::never();
    std::uint8_t syncs = 0;        // Since it was sent last.
    bool waits_for_start = false;  // For the SYNC with its start value.
  };

  AbortCode read(Instant now, ObjectAddress address, std::vector<std::uint8_t>& value) override;
  AbortCode begin_write(ObjectAddress address, std::optional<std::size_t> size) override;
  std::size_t capacity(ObjectAddress address) override;
  AbortCode write(Instant now, ObjectAddress address, std::span<const std::uint8_t> value) override;

  [[nodiscard]] AbortCode check_communication_write(ObjectAddress address, std::span<const std::uint8_t> value);
  [[nodiscard]] AbortCode check_heartbeat_consumer(ObjectAddress address, std::uint32_t value) const;
  AbortCode execute_store_command(Instant now, ObjectAddress address, std::uint32_t signature);
  void apply_communication_write(Instant now, ObjectAddress address, std::uint32_t old_value);
  void apply_pdo_write(Instant now, std::uint16_t index);

  void reset(Instant now, ResetKind kind, Frames& out);
  void read_communication_parameters(Instant now);
  void read_heartbeat_consumers();
  void replace_heartbeat_consumer(std::uint32_t old_value, std::uint32_t value);
  void read_sync_parameters(Instant now);
  void update_interest();
  void update_deadline();

  void on_nmt(Instant now, const can::CanFrame& frame, Frames& out);
  void on_sync_frame(Instant now, const can::CanFrame& frame, Frames& out);
  void handle_sync(Instant now, std::uint8_t counter, Frames& out);
  void on_rpdo_frame(Instant now, const can::CanFrame& frame);
  void receive_rpdo(Instant now, Rpdo& rpdo, const can::CanFrame& frame);
  void apply_rpdo(Instant now, Rpdo& rpdo, const std::uint8_t* bytes);
  void on_remote_frame(Instant now, const can::CanFrame& frame, Frames& out);
  void on_guard_request(Instant now, Frames& out);
  void on_heartbeat_event(Instant now, const HeartbeatEvent& event, Frames& out);
  void on_communication_lost(Instant now, std::uint8_t instance, Frames& out);
  void check_guarding(Instant now, Frames& out);

  void send_heartbeat_if_due(Instant now, Frames& out);
  void produce_sync_if_due(Instant now, Frames& out);
  void check_rpdo_deadlines(Instant now);
  void send_tpdo(Instant now, Tpdo& tpdo, Frames& out);
  void send_synchronous_tpdos(Instant now, std::uint8_t counter, Frames& out);
  void send_due_tpdos(Instant now, Frames& out);
  void arm_pdos(Instant now);
  void arm_tpdo(Instant now, Tpdo& tpdo);
  void disarm_pdos();
  [[nodiscard]] bool may_send_emcy() const;
  void flush(Instant now, Frames& out);

  ObjectDictionary dictionary_;
  std::uint8_t node_id_;
  NodeListener* listener_;
  NodeListener silent_;
  NmtState state_ = NmtState::kInitialising;
  Instant now_{};
  Instant deadline_ = Instant::never();

  SdoServer sdo_;
  EmcyProducer emcy_;
  HeartbeatConsumer heartbeats_;
  ParameterStore parameters_;
  std::vector<Rpdo> rpdos_;
  std::vector<Tpdo> tpdos_;

  Nanos heartbeat_period_{};
  Instant heartbeat_due_ = Instant::never();
  std::uint8_t guard_toggle_ = 0;
  Instant guard_expires_ = Instant::never();

  std::uint32_t sync_id_ = cob_id::kSync;
  std::uint8_t sync_overflow_ = 0;
  std::uint8_t sync_counter_ = 0;
  Nanos sync_period_{};
  Nanos sync_window_{};
  Instant sync_due_ = Instant::never();
  Instant last_sync_{};

  bool any_extended_pdo_ = false;
  std::array<std::uint8_t, can::kMaxStandardId + 1> interest_{};
};

}  // namespace meltbench::canopen
