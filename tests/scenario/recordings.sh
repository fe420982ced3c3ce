#!/bin/sh
# Extracts a scenario of every recording of fixtures/recordings, compares it with the one that lies beside it, and runs it.
# Usage: recordings.sh MELTBENCH FOLDER; from the root of the repository.
set -eu
meltbench=$1
out=$2
mkdir -p "$out"
bad=0
count=0
for log in fixtures/recordings/*.log.gz; do
  name=$(basename "$log" .log.gz)
  count=$((count + 1))
  story=fixtures/recordings/$name.md
  [ -f "$story" ] || { echo "$story is missing: what is the story?"; bad=1; continue; }
  machine=$(sed -n 's/^Machine: //p' "$story")
  serial=""
  [ ! -f "fixtures/recordings/$name.serial.gz" ] || serial="--serial fixtures/recordings/$name.serial.gz"
  # shellcheck disable=SC2086
  "$meltbench" extract "$log" $serial --scenario "fixtures/recordings/${machine:-production.toml}" -o "$out/$name.toml" > "$out/$name.txt"
  # The rig's path depends on where the scenario lies.
  grep -v '^rig = ' "$out/$name.toml" > "$out/$name.new"
  grep -v '^rig = ' "fixtures/recordings/$name.toml" > "$out/$name.old"
  if ! diff "$out/$name.old" "$out/$name.new"; then
    echo "  ^ $name: the log gives another scenario than fixtures/recordings/$name.toml"
    bad=1
  fi
  "$meltbench" run "fixtures/recordings/$name.toml" --in-process --quiet --out "$out/$name" || bad=1
done
[ $count -ge 10 ] || { echo "only $count recordings"; bad=1; }
exit $bad
