# The guest's CAN interfaces. Sourced by guest.sh before the first step.
for name in vcan0 vcan1; do
  ip link add dev "$name" type vcan
  ip link set "$name" mtu 72
  ip link set "$name" up
done
# Two emulated cards on one wire; restart-ms brings a card back from bus-off.
for name in can0 can1; do
  ip link set "$name" type can bitrate 500000 restart-ms 100
  ip link set "$name" txqueuelen 100
  ip link set "$name" up
done
