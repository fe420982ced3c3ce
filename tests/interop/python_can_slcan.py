"""python3-can's slcan interface on the adapter that a run offers at a pseudo-terminal.

It reads version and serial number, sees each frame of the bus, and sends frames of every kind and length, which another
program on the tap sees and bus.log holds as they were sent. Usage: python_can_slcan.py MELTBENCH.
Status 77: python3-can or python3-serial is not installed.
"""
import contextlib
import logging
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import threading

with contextlib.suppress(ImportError):
    import can
    import serial

SCENARIO = str(pathlib.Path(__file__).with_name("tapped.toml"))
FRAMES = 1_000  # To send.
SEEN = 1_000    # To see at least.


def make_frame(number):
    """Standard and extended, data and remote, of every length."""
    extended, remote, length = number % 2 == 1, number % 10 == 0, number % 9
    return can.Message(arbitration_id=0x18000000 + number if extended else 0x7A0 + number % 8, is_extended_id=extended,
                       is_remote_frame=remote, dlc=length,
                       data=None if remote else bytes((number + k) & 0xFF for k in range(length)))


def to_candump(message):
    """As bus.log has it. slcan says the length of a remote frame, too."""
    data = f"R{message.dlc or ''}" if message.is_remote_frame else bytes(message.data).hex().upper()
    return f"{message.arbitration_id:0{8 if message.is_extended_id else 3}X}#{data}"


def receive(bus, heard, is_enough=lambda message: False):
    with contextlib.suppress(can.CanError):  # The end of the run closes the adapter.
        while (message := bus.recv(3)) is not None:
            heard.append(message)
            if is_enough(message):
                return


def is_part_of(part, whole):
    """Whether `part` stands in `whole` without a gap."""
    return any(whole[at:at + len(part)] == part for at in range(len(whole) - len(part) + 1))


def main():
    if "serial" not in globals():
        print("python3-can or python3-serial is not installed")
        return 77
    logging.disable(logging.ERROR)
    failures = 0

    def check(holds, statement):
        nonlocal failures
        failures += not holds
        print(f"{'ok' if holds else 'FAILED'}: {statement}")

    with tempfile.TemporaryDirectory() as folder:
        port = f"{folder}/slcan"
        bench = subprocess.Popen([sys.argv[1], "run", SCENARIO, "--pace", "realtime", "--slcan-pty", port, "--tap", "0",
                                  "--tap-wait", "2", "--quiet", "--out", f"{folder}/out"], stdout=subprocess.PIPE, text=True)
        places = bench.stdout.readline() + bench.stdout.readline()  # "tap: slcan on ...": it is there now.
        other = can.Bus(interface="socketcand", channel="can0", host="127.0.0.1",
                        port=int(re.search(r"127\.0\.0\.1:(\d+)\n", places).group(1)))
        bus = can.Bus(interface="slcan", channel=port, bitrate=500_000, sleep_after_open=0)
        check(bus.get_version(3) == (10, 13) and bus.get_serial_number(3) == "A123", "version 10.13, serial number A123")
        heard, heard_by_other = [], []
        last = make_frame(FRAMES - 1).arbitration_id
        has_seen_enough = threading.Event()

        def note(_):
            if len(heard) >= SEEN:
                has_seen_enough.set()

        receivers = [threading.Thread(target=receive, args=(bus, heard, note)),
                     threading.Thread(target=receive, args=(other, heard_by_other, lambda message: message.arbitration_id == last))]
        for receiver in receivers:
            receiver.start()
        for number in range(FRAMES):
            bus.send(make_frame(number))
        receivers[1].join()
        has_seen_enough.wait(20)
        bench.send_signal(signal.SIGINT)
        receivers[0].join()
        bench.communicate(timeout=30)
        log = [line.split() for line in open(f"{folder}/out/bus.log")]

    sent = [to_candump(make_frame(number)) for number in range(FRAMES)]
    logged = [frame for _, device, frame in log if device == "tap"]
    check(logged == sent, f"bus.log has {len(logged)} of {FRAMES} frames that were sent, all equal, in order")
    seen = [to_candump(message) for message in heard]
    of_bench = [frame for _, device, frame in log if device == "bench"]
    check(len(seen) >= SEEN and is_part_of(seen, of_bench), f"{len(seen)} of {len(of_bench)} frames of the bench were shown, without a gap")
    data = [frame for frame in sent if "R" not in frame]  # socketcand has no word for remote frames.
    others = [to_candump(message) for message in heard_by_other if message.arbitration_id in range(0x7A0, 0x7A8) or message.arbitration_id >= 0x800]
    check([f.split("#")[1] for f in others] == [f.split("#")[1] for f in data], f"the other program saw {len(others)} of {len(data)} data frames")
    return min(failures, 1)


if __name__ == "__main__":
    sys.exit(main())
