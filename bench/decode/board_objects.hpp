#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "protocols/can/frame.hpp"
#include "protocols/canopen/object_dictionary.hpp"
#include "protocols/canopen/pdo.hpp"
#include "protocols/config/rig.hpp"

namespace meltbench::decode {

/// An object in a PDO, and its bytes in the frame.
struct MappedObject {
  const canopen::OdEntry* entry = nullptr;
  std::size_t first = 0;
  std::size_t size = 0;
};

/// A PDO of a board as it is mapped now; gaps and objects that the EDS does not have are left out.
struct FollowedPdo {
  canopen::PdoDirection direction{};
  canopen::Pdo pdo;
  std::vector<MappedObject> objects;
};

/// Number of an object of this type in these wire bytes; 0 for a string.
[[nodiscard]] double to_number(const canopen::OdEntry& entry, std::span<const std::uint8_t> bytes);

/// The objects of a CAN board as a listener on the wire can know them: by its EDS, and by what a master writes by
/// expedited SDO, from the board's answer on. A board that boots has the PDOs of its EDS again.
class BoardObjects {
 public:
  /// @throws config::ConfigError at the board, if its EDS cannot be used.
  explicit BoardObjects(const config::RigBoard& board);

  /// What a frame has changed.
  struct Change {
    const canopen::OdEntry* written = nullptr;  ///< Has a new value by SDO.
    bool pdos = false;                          ///< Some PDO is another one now.
  };
  /// Takes note of a frame of the bus. Cost: some ns, no allocation unless it changes something.
  Change follow(const can::CanFrame& frame);

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] std::uint8_t node_id() const { return node_id_; }
  [[nodiscard]] const canopen::ObjectDictionary& dictionary() const { return dictionary_; }
  /// Both directions. They stay where they are.
  [[nodiscard]] std::span<const FollowedPdo> pdos() const { return pdos_; }

 private:
  struct Write {
    canopen::ObjectAddress address;
    std::vector<std::uint8_t> value;
  };

  void take_request(const can::CanFrame& frame);
  [[nodiscard]] Change take_answer(const can::CanFrame& frame);
  [[nodiscard]] Change restore_pdos();
  void read_again(FollowedPdo& followed);
  void list_objects(FollowedPdo& followed);

  std::string name_;
  std::uint8_t node_id_;
  canopen::ObjectDictionary dictionary_;
  std::vector<FollowedPdo> pdos_;
  std::optional<Write> asked_;  ///< SDO download that the board has not answered yet.
};

}  // namespace meltbench::decode
