#!/bin/sh
# Checks that each room includes only what it may: the table of the README, "The rooms". Prints each offending line.
# Run from the root of the repository.
set -eu
bad=0

# room FOLDER ALLOWED...: every #include "..." below FOLDER starts with one of ALLOWED (FOLDER itself is allowed).
room() {
  folder=$1
  shift
  allowed="$folder/"
  for name in "$@"; do allowed="$allowed|$name/"; done
  if grep -rnE '^ *#include "' "$folder" --include='*.hpp' --include='*.cpp' | grep -vE "#include \"($allowed)"; then
    echo "  ^ $folder may include only: $(echo "$allowed" | tr '|' ' ')"
    bad=1
  fi
}

# pure FOLDER...: no input or output, no clock, no logger.
pure() {
  for folder in "$@"; do
    if grep -rnE '#include <(sys/|unistd|poll|fcntl|thread|iostream|fstream|cstdio|spdlog|time\.h)|(steady|system)_clock' "$folder"; then
      echo "  ^ $folder is pure: it takes time and bytes as arguments and returns"
      bad=1
    fi
  done
}

p=protocols
room $p/time
room $p/can          $p/time
room $p/participant  $p/time $p/can
room $p/canopen      $p/time $p/can
room $p/modbus       $p/time
room $p/serial       $p/time
room $p/config       $p/time $p/serial
room $p/fault        $p/time $p/can $p/serial $p/config
room $p/link         $p/time $p/can $p/serial
room $p/runtime      $p/time $p/can $p/serial $p/participant $p/link
room $p/program      $p/time $p/can $p/serial $p/config $p/participant $p/link $p/runtime
room plant_emulator/model    $p/time
room plant_emulator/board  plant_emulator/model $p/time $p/can $p/canopen $p/modbus $p/participant $p/config
room controller/law        $p/time
room controller/estimator  $p/time controller/law
room controller/safety     $p/time
room controller/machine    controller/law controller/estimator controller/safety \
                           $p/time $p/can $p/canopen $p/modbus $p/participant $p/config
room bench/record    $p
room bench/check     $p bench/record
room bench/scenario  $p
room bench/report    $p bench/record bench/check
room bench/bus       $p
room bench/tap       $p bench/bus
room bench/log       $p/time $p/can $p/link
room bench/decode    $p
room bench/replay    $p bench/decode bench/log
room bench/fault     $p bench/bus
room plant_emulator  $p
room controller      $p
pure $p/time $p/can $p/serial $p/participant $p/canopen $p/modbus plant_emulator/model plant_emulator/board \
     controller/law controller/estimator controller/safety controller/machine bench/check

[ $bad -eq 0 ] && echo "every room includes only what it may"
exit $bad
