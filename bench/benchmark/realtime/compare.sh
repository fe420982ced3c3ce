#!/bin/sh
# How late our real-time driver wakes up, beside cyclictest with the same priority and period, started alternately.
# Usage, from the root: compare.sh [BIN].  ROUNDS (5), TICKS per round (10000), PERIOD_us (1000) and PRIORITY (80) from the
# environment. Where SCHED_FIFO is refused both run at SCHED_OTHER, and it is said. Ends with status 1 if our p99.9 is more
# than 1.3 times that of cyclictest; 77 without cyclictest (Debian: rt-tests).
set -eu
bin=${1:-build/release/bin}
rounds=${ROUNDS:-5}
ticks=${TICKS:-10000}
period_us=${PERIOD_us:-1000}
priority=${PRIORITY:-80}
command -v cyclictest >/dev/null || { echo "cyclictest is not installed (Debian: rt-tests)"; exit 77; }

ours="--rt $priority"
theirs="--priority=$priority"
scheduling="SCHED_FIFO $priority"
if ! chrt -f "$priority" true 2>/dev/null; then
  ours=
  theirs=--policy=other
  scheduling="SCHED_OTHER, because SCHED_FIFO is refused here"
fi

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
round=0
while [ "$round" -lt "$rounds" ]; do
  # shellcheck disable=SC2086  # Options, or none.
  "$bin/meltbench_wakeup_lateness" --period-us "$period_us" --ticks "$ticks" $ours >>"$folder/meltbench"
  cyclictest --quiet --mlockall --interval="$period_us" --loops="$ticks" --histogram=100000 "$theirs" >>"$folder/cyclictest"
  round=$((round + 1))
done

echo "$rounds rounds of $ticks wake-ups each, every $period_us us, $scheduling"
printf '%-12s%10s%10s%10s%10s%10s   late by [us]\n' '' count p50 p99 p99.9 max
for who in meltbench cyclictest; do
  # Lines of "MICROSECONDS COUNT"; cyclictest's comments begin with #.
  grep -E '^[0-9]+ [0-9]+$' "$folder/$who" | awk '$2 + 0 > 0 { print $1 + 0, $2 + 0 }' | sort -n | awk -v who="$who" '
    { us[NR] = $1; of[NR] = $2; n += $2 }
    function quantile(share,   i, below) {
      for (i = 1; i <= NR; ++i) { below += of[i]; if (below >= share * n) return us[i] }
      return us[NR]
    }
    END { printf "%-12s%10d%10d%10d%10d%10d\n", who, n, quantile(0.5), quantile(0.99), quantile(0.999), us[NR] }'
done | tee "$folder/table"
awk '{ late[$1] = $5 } END {
  ratio = late["meltbench"] / (late["cyclictest"] > 0 ? late["cyclictest"] : 1)
  printf "p99.9: %.2f times that of cyclictest; asked for: at most 1.3\n", ratio
  exit ratio > 1.3
}' "$folder/table"
