"""Our boards behind an slcan line, with python3-can's slcan interface at the other end of it.

plant_emulator --can slcan:... speaks what a host speaks to an adapter; python3-can does, too, and each takes the other
for one. It sees the boards boot, resets one of them, and reads an object of each by SDO.
Usage: python_can_slcan_link.py PLANT_EMULATOR. Status 77: python3-can or python3-serial is not installed.
"""
import contextlib
import os
import pathlib
import subprocess
import sys
import tempfile
import time

with contextlib.suppress(ImportError):
    import can
    import serial

RIG = str(pathlib.Path(__file__).parents[2] / "fixtures/rigs/bizone.toml")
BOARDS = (5, 6, 7)
TIMEOUT_S = 10


def receive(bus, is_wanted):
    """The first message that is wanted; None if none comes in time."""
    until = time.monotonic() + TIMEOUT_S
    while time.monotonic() < until:
        message = bus.recv(0.2)
        if message is not None and is_wanted(message):
            return message
    return None


def check(bus):
    for node in BOARDS:
        # The device type, 1000:00, by an expedited upload.
        bus.send(can.Message(arbitration_id=0x600 + node, is_extended_id=False, data=[0x40, 0, 0x10, 0, 0, 0, 0, 0]))
        answer = receive(bus, lambda message, node=node: message.arbitration_id == 0x580 + node)
        if answer is None or bytes(answer.data[:4]) != bytes([0x43, 0, 0x10, 0]) or answer.is_extended_id:
            return f"node {node} answers SDO with {answer}"
    bus.send(can.Message(arbitration_id=0, is_extended_id=False, data=[0x81, BOARDS[0]]))
    boot = receive(bus, lambda message: message.arbitration_id == 0x700 + BOARDS[0] and bytes(message.data) == b"\0")
    return None if boot else "no boot-up of a node that was reset"


def main(emulator):
    if "can" not in globals() or "serial" not in globals():
        print("python3-can and python3-serial are not installed")
        return 77
    with tempfile.TemporaryDirectory() as folder:
        line = f"{folder}/line"
        with subprocess.Popen([emulator, "--rig", RIG, "--can", f"slcan:pty:{line}@500000"],
                              stderr=subprocess.DEVNULL) as plant:
            try:
                while not os.path.islink(line) and plant.poll() is None:
                    time.sleep(0.01)
                bus = can.Bus(interface="slcan", channel=line, bitrate=500000)
                complaint = check(bus)
                bus.shutdown()
            finally:
                plant.terminate()
        if complaint:
            print(f"failed: {complaint}")
            return 1
    print(f"{len(BOARDS)} boards answered over slcan")
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
