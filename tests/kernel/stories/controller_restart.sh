# The controller runs beside the bench, as at a machine. It dies after 3 s; somebody starts it again 1.5 s later.
start_controller() {
  controller --rig "$PROJECT/fixtures/rigs/coupled.toml" --can vcan0 --rt 30 &
  controller_pid=$!
}
candump -n 1 vcan0  # The boards are there.
start_controller
sleep 3
kill -KILL $controller_pid
wait $controller_pid || true
sleep 1.5
start_controller
sleep 3.5
