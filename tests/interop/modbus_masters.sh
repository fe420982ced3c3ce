#!/bin/sh
# Another Modbus master works with the RTU boards of plant_emulator, over a pseudo-terminal.
# Usage, from the root: modbus_masters.sh PLANT_EMULATOR pymodbus | mbpoll | npm [BUILD_FOLDER].
# Status 77: the master cannot be had; the last line says why.
set -eu
emulator=$1
master=$2
build=${3:-build/release}
here=$(dirname "$0")

skip() { echo "$1"; exit 77; }
case $master in
  pymodbus) /usr/bin/python3 -c 'import pymodbus, serial' 2>/dev/null || skip "python3-pymodbus is not installed" ;;
  mbpoll) command -v mbpoll >/dev/null || skip "mbpoll is not installed" ;;
  npm)
    command -v npm >/dev/null || skip "npm is not installed"
    mkdir -p "$build/npm/modbus"
    [ -d "$build/npm/modbus/node_modules/modbus-serial" ] ||
      npm install --prefix "$build/npm/modbus" --no-audit --no-fund --silent modbus-serial@8.0.25 ||
      skip "npm cannot fetch modbus-serial@8.0.25" ;;
esac

folder=$(mktemp -d)
"$emulator" --rig "$here/modbus_rig.toml" --can none --line "dosing=pty:$folder/dosing" 2>"$folder/emulator.log" &
process=$!
trap 'kill $process 2>/dev/null || true; rm -rf "$folder"' EXIT
tries=0
until [ -e "$folder/dosing" ]; do
  tries=$((tries + 1))
  [ $tries -lt 100 ] && kill -0 $process 2>/dev/null || { cat "$folder/emulator.log"; exit 1; }
  sleep 0.05
done

case $master in
  pymodbus) /usr/bin/python3 "$here/modbus_pymodbus.py" "$folder/dosing" ;;
  mbpoll) "$here/modbus_mbpoll.sh" "$folder/dosing" 19200 none ;;
  npm) NODE_PATH="$build/npm/modbus/node_modules" node "$here/modbus_serial.js" "$folder/dosing" ;;
esac
