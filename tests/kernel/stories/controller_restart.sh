# The controller runs beside the bench, as at a machine. It dies after 3 s; somebody starts it again 1.5 s later.
start_controller() {
  controller --rig run/repro.toml --can vcan0 --rt 30 &
  controller_pid=$!
}
start_controller
sleep 3
kill -KILL $controller_pid
wait $controller_pid || true
sleep 1.5
start_controller
sleep 3.5
