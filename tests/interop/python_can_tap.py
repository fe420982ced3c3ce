"""python3-can's socketcand interface over the tap.

Burst: two programs send 20,000 frames each at once, at wall-clock pace: none lost, none changed, order kept, in either
direction. Looking on: a run in lockstep shows each frame of its bus.log, and leaves the same bytes as without a tap.
Sending in lockstep: the run says that it cannot be repeated.

Usage: python_can_tap.py MELTBENCH. Status 77: python3-can is not installed.
"""
import contextlib
import filecmp
import json
import logging
import pathlib
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading

with contextlib.suppress(ImportError):
    import can

SCENARIO = str(pathlib.Path(__file__).with_name("tapped.toml"))
FRAMES = 20_000
OWN_ID = 0x7A0  # 0x7A0 and 0x7A1: nobody in the rig listens to them.


def start_bench(meltbench, out, *options):
    bench = subprocess.Popen([meltbench, "run", SCENARIO, "--tap", "0", "--quiet", "--out", out, *options],
                             stdout=subprocess.PIPE, text=True)
    port = int(re.fullmatch(r"tap: socketcand on 127\.0\.0\.1:(\d+)\n", bench.stdout.readline()).group(1))
    return bench, port


def connect(port):
    return can.Bus(interface="socketcand", channel="can0", host="127.0.0.1", port=port)


def make_frame(sender, number):
    # Every length, every byte value; the number says which frame this is.
    data = (number.to_bytes(3, "big") + bytes((number * k) & 0xFF for k in range(3, 8)))[: 3 + number % 6]
    return can.Message(arbitration_id=OWN_ID + sender, is_extended_id=False, data=data)


def send_all(bus, sender):
    for number in range(FRAMES):
        bus.send(make_frame(sender, number))


def receive(bus, sender, heard, others):
    """Until all frames of the other program are there, or none came for 5 s."""
    while len(heard) < FRAMES:
        message = bus.recv(5)
        if message is None:
            return
        (heard if message.arbitration_id == OWN_ID + 1 - sender else others).append(message)


def test_burst(meltbench, out):
    bench, port = start_bench(meltbench, out, "--pace", "realtime", "--tap-wait", "2")
    buses = [connect(port) for _ in range(2)]
    heard, others = [[], []], [[], []]
    threads = [threading.Thread(target=send_all, args=(buses[n], n)) for n in range(2)]
    threads += [threading.Thread(target=receive, args=(buses[n], n, heard[n], others[n])) for n in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    bench.send_signal(signal.SIGINT)
    bench.communicate(timeout=30)

    failures = 0
    log = [line.split() for line in open(f"{out}/bus.log")]
    for n in range(2):
        sent = [bytes(make_frame(n, number).data) for number in range(FRAMES)]
        got = [bytes(message.data) for message in heard[1 - n]]
        logged = [bytes.fromhex(frame[4:]) for _, device, frame in log if device == "tap" and frame[:3] == f"{OWN_ID + n:03X}"]
        for where, frames in (("the other program", got), ("bus.log", logged)):
            equal = frames == sent
            print(f"burst of program {n}: {len(frames)} of {FRAMES} frames in {where}, {'all equal, in order' if equal else 'NOT equal'}")
            failures += not equal
        failures += not others[n]  # Beside the burst it has seen the bench.
    lost = json.load(open(f"{out}/result.json"))["bus"]["lost_frames"]
    print(f"burst: {lost} lost frames in result.json")
    return failures + lost


def test_looking_on(meltbench, out):
    bench, port = start_bench(meltbench, out, "--tap-wait", "1", "--tap-read-only")
    bus = connect(port)
    seen = []
    with contextlib.suppress(Exception):  # The end of the run closes the connection.
        while (message := bus.recv(5)) is not None or bench.poll() is None:
            if message is not None:
                seen.append((f"{message.timestamp:017.6f}", f"{message.arbitration_id:03X}#{bytes(message.data).hex().upper()}"))
    output, _ = bench.communicate(timeout=30)
    logged = [(stamp.strip("()"), frame) for stamp, _, frame in map(str.split, open(f"{out}/bus.log"))]
    print(f"lockstep: {len(seen)} of {len(logged)} frames shown, {'all equal, in order' if seen == logged else 'NOT equal'}")
    subprocess.run([meltbench, "run", SCENARIO, "--quiet", "--out", f"{out}/alone"], stdout=subprocess.DEVNULL, check=True)
    files = ["bus.log", "signals.csv", "events.jsonl", "result.json"]
    _, different, missing = filecmp.cmpfiles(out, f"{out}/alone", files, shallow=False)
    print(f"lockstep: {'the same bytes as without a tap' if not different + missing else f'NOT the same: {different + missing}'}")
    return (seen != logged) + len(different + missing) + bench.returncode


def test_sending_in_lockstep(meltbench, out):
    bench, port = start_bench(meltbench, out, "--tap-wait", "1")
    with socket.create_connection(("127.0.0.1", port)) as program:  # Sends before the run begins: it waits for that.
        program.sendall(b"< open can0 >< rawmode >< send 7A0 1 AB >< send 7A1 1 CD >")
        while program.recv(65536):
            pass
    bench.communicate(timeout=30)
    entered = [line.split()[1:] for line in open(f"{out}/bus.log") if " bench " not in line]
    events = [line for line in open(f"{out}/events.jsonl") if "frames-from-outside" in line]
    reproducible = json.load(open(f"{out}/result.json"))["reproducible"]
    print(f"lockstep: {entered} from outside, {len(events)} event, reproducible: {reproducible}")
    return (entered != [["tap", "7A0#AB"], ["tap", "7A1#CD"]]) + (len(events) != 1) + reproducible


def main():
    if "can" not in globals():
        print("python3-can is not installed")
        return 77
    logging.disable(logging.ERROR)  # 4.1.0 warns of each line end between frames.
    with tempfile.TemporaryDirectory() as folder:
        tests = {"burst": test_burst, "looking_on": test_looking_on, "sending": test_sending_in_lockstep}
        failures = sum(test(sys.argv[1], f"{folder}/{name}") for name, test in tests.items())
    return min(failures, 1)


if __name__ == "__main__":
    sys.exit(main())
