#!/bin/sh
# mbpoll (libmodbus) works with the feeder at unit 1: every function that it has, and what is refused.
# Usage: modbus_mbpoll.sh PORT [BAUD_RATE [none | even | odd]].  The rig is modbus_rig.toml, or one like it.
set -eu
port=$1
baud=${2:-19200}
parity=${3:-even}
checks=0

poll() { mbpoll -m rtu -a 1 -b "$baud" -P "$parity" -0 -1 -o 1 -B "$@" 2>&1; }

# reads WHAT PATTERN OPTIONS...: one line of the answer fits.
reads() {
  what=$1 pattern=$2
  shift 2
  checks=$((checks + 1))
  answer=$(poll "$@" "$port") || true
  echo "$answer" | grep -qE "$pattern" || { echo "failed: $what: expected $pattern in"; echo "$answer"; exit 1; }
}
# writes WHAT PATTERN OPTIONS... -- VALUES...
writes() {
  what=$1 pattern=$2
  shift 2
  options=
  while [ "$1" != -- ]; do options="$options $1"; shift; done
  shift
  checks=$((checks + 1))
  # shellcheck disable=SC2086
  answer=$(poll $options "$port" -- "$@") || true
  echo "$answer" | grep -qE "$pattern" || { echo "failed: $what: expected $pattern in"; echo "$answer"; exit 1; }
}

writes "set point (function 16)"          'Written 1 references'  -t 4:float -r 0 -- 5.25
reads  "set point in force (3)"           '\[118\]:[[:space:]]+5\.25' -t 4:float -r 118
reads  "the same as input register (4)"   '\[18\]:[[:space:]]+5\.25'  -t 3:float -r 18
reads  "largest flow"                     '\[120\]:[[:space:]]+20'    -t 4:float -r 120
reads  "latency, 32-bit"                  '\[122\]:[[:space:]]+2000'  -t 4:int -r 122
writes "refill limits, two floats (16)"   'Written 2 references'  -t 4:float -r 2 -- 2 10.5
reads  "both of them"                     '\[4\]:[[:space:]]+10\.5'   -t 4:float -r 2 -c 2
writes "mode volumetric (6)"              'Written 1 references'  -t 4 -r 9 -- 1
reads  "acting mode"                      '\[116\]:[[:space:]]+1'     -t 4 -r 116
reads  "discrete input volumetric (2)"    '\[6\]:[[:space:]]+1'       -t 1 -r 0 -c 7
writes "coil volumetric off (5)"          'Written 1 references'  -t 0 -r 1 -- 0
reads  "all coils (1)"                    '\[1\]:[[:space:]]+0'       -t 0 -r 0 -c 5
writes "clear totalizer and tare (15)"    'Written 2 references'  -t 0 -r 3 -- 1 1
reads  "whole report"                     '\[125\]:'                  -t 4 -r 100 -c 26

reads  "1 illegal function (17)"          'Illegal function'          -u
reads  "2 illegal address"                'Illegal data address'      -t 4 -r 50
reads  "2 beyond the report"              'Illegal data address'      -t 3 -r 20 -c 7
writes "2 read only"                      'Illegal data address'      -t 4 -r 100 -- 1
writes "2 half of a float"                'Illegal data address'      -t 4 -r 0 -- 1
reads  "2 no such coil"                   'Illegal data address'      -t 0 -r 5
writes "3 illegal value"                  'Illegal data value'        -t 4 -r 9 -- 7
writes "3 limits out of order"            'Illegal data value'        -t 4:float -r 2 -- 11
writes "stop"                             'Written 1 references'  -t 0 -r 0 -- 0
writes "refill"                           'Written 1 references'  -t 0 -r 2 -- 1
writes "6 busy: tare while refilling"     'Slave device or server is busy' -t 0 -r 4 -- 1
sleep 1
writes "4 device failure: refill when full" 'Slave device or server failure' -t 0 -r 2 -- 1
echo "mbpoll: $checks checks held on $port"
