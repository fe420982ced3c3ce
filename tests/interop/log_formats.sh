#!/bin/sh
# Logs between us and other people's programs: python3-can reads what `meltbench convert` writes (candump, ASC, BLF) and
# it reads what python3-can writes; tshark reads our candump and BLF; can-utils reads our candump, and we its ASC.
# Usage, from the root: log_formats.sh [MELTBENCH].  Status 77: one of the programs is not installed.
set -eu
meltbench=${1:-build/release/bin/meltbench}
for program in tshark log2asc /usr/bin/python3; do
  command -v "$program" >/dev/null || { echo "$program is not installed"; exit 77; }
done
/usr/bin/python3 -c 'import can' 2>/dev/null || { echo "python3-can is not installed"; exit 77; }

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
exec /usr/bin/python3 tests/interop/log_formats.py "$meltbench" "$folder"
