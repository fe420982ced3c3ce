#pragma once

#include <string>

#include "protocols/serial/line_settings.hpp"

namespace meltbench::serial {

/// Which port of this machine a line of the rig is on.
struct LinePort {
  std::string line;  ///< Its name in the rig.
  std::string port;  ///< E.g. "/dev/ttyUSB0": see link::SerialPort.
  LineSettings settings;
};

}  // namespace meltbench::serial
