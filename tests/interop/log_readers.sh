#!/bin/sh
# Other people's programs read our bus.log: tshark decodes every frame as CANopen, python3-can and can-utils read all.
# Usage, from the root: log_readers.sh [MELTBENCH [SCENARIO]].  Status 77: one of the programs is not installed.
set -eu
meltbench=${1:-build/release/bin/meltbench}
scenario=${2:-fixtures/scenarios/delay_compensation.toml}
for program in tshark log2asc /usr/bin/python3; do
  command -v "$program" >/dev/null || { echo "$program is not installed"; exit 77; }
done
/usr/bin/python3 -c 'import can' 2>/dev/null || { echo "python3-can is not installed"; exit 77; }

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$meltbench" run "$scenario" --in-process --quiet --out "$folder" >/dev/null
log=$(find "$folder" -name bus.log | sort | head -n 1)
frames=$(wc -l <"$log")

decoded=$(tshark -r "$log" -d can.subdissector,canopen -T fields -e _ws.col.Protocol 2>/dev/null | grep -c '^CANopen$')
malformed=$(tshark -r "$log" -d can.subdissector,canopen -Y _ws.malformed 2>/dev/null | wc -l)
python_can=$(/usr/bin/python3 -c 'import can, sys; print(sum(1 for _ in can.LogReader(sys.argv[1])))' "$log")
asc=$(log2asc -I "$log" bench | grep -cE ' Rx | Tx ')

echo "$frames frames; tshark decoded $decoded as CANopen, $malformed malformed; python3-can read $python_can; log2asc $asc"
[ "$decoded" -eq "$frames" ] && [ "$malformed" -eq 0 ] && [ "$python_can" -eq "$frames" ] && [ "$asc" -eq "$frames" ]
