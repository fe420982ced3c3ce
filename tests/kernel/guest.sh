# Inside a guest, in dash (busybox's own shell prefers busybox's ip to the real one): runs the steps named by $STEPS, one
# after another, and leaves in $OUT what each one printed, its folder of results, and a line "NAME STATUS SECONDS" in
# `steps`. STEP:WORD gives the step that word. Status 0 passed, 77 skipped (last line printed: why).
set -u
export KERNEL="$PROJECT/tests/kernel" PATH="$BIN:$PATH"
step_limit_s=600  # of guest time

seconds() { cut -d ' ' -f 1 /proc/uptime; }

. "$KERNEL/buses.sh"
for name in $STEPS; do
  folder=/run/steps/$name
  mkdir -p "$folder"
  began=$(seconds)
  # Results are collected in memory, too, and brought to the host when the step is over.
  (cd "$folder" && timeout $step_limit_s dash -eu "$KERNEL/steps/${name%%:*}" "${name#*:}") >"$folder/output.txt" 2>&1
  status=$?
  [ $status -ne 143 ] || echo "not over after $step_limit_s s" >>"$folder/output.txt"  # the time-out's SIGTERM
  took=$(seconds | awk -v began="$began" '{ printf "%.1f", $1 - began }')
  cp -r "$folder" "$OUT/"
  rm -rf "$folder"
  echo "$name $status $took" >>"$OUT/steps"
  echo "guest: $name ended with status $status after $took s"
done
