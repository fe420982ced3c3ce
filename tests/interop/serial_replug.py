"""A serial adapter that is unplugged in mid-run and plugged in again, as another device behind the same name.

The feeder's line is two pseudo-terminals with this program as the cable between them. Unplugging closes the
controller's; plugging in moves its name, a link as udev makes them, to a new one with another minor number. What must
follow is judged by the order of events, not by the run's own verdict: on a busy machine a board may be late for once.
Usage: serial_replug.py MELTBENCH.
"""
import json
import os
import pathlib
import pty
import select
import subprocess
import sys
import tempfile
import time
import tty

SCENARIO = str(pathlib.Path(__file__).with_name("replug.toml"))
FOLLOWS = [  # Each after the one before: (source, code).
    ("controller", "running"),
    ("controller", "port-down"),
    ("controller", "line-down"),  # Safe state.
    ("controller", "device-lost"),
    ("controller", "port-up"),
    ("controller", "device-back"),
]
UNPLUGGED_S, PLUGGED_S = 1.0, 2.5  # Since the controller runs; the run takes 7 s.


class Adapter:
    """The controller's end of the cable, behind a name that stays the same."""

    def __init__(self, name):
        self.name, self.master, self.device, self.spare = name, None, None, []
        self.plug()

    def plug(self):
        before = self.device
        while self.device == before:  # The number that has become free is taken, and not used.
            self.spare.append(self.master)
            self.master, far_end = pty.openpty()
            self.device = os.ttyname(far_end)
        tty.setraw(far_end)
        if os.path.islink(self.name):
            os.remove(self.name)
        os.symlink(self.device, self.name)
        os.close(far_end)

    def unplug(self):
        os.close(self.master)
        self.master = None


def carry(source, target):
    try:
        data = os.read(source, 4096)
        if target is not None:
            os.write(target, data)
    except OSError:  # Nobody has the other end open yet, or any more.
        time.sleep(0.005)


def read_events(folder):
    """What has been reported so far."""
    path = pathlib.Path(folder, "out", "events.jsonl")
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return [event for event in map(json.loads, lines) if event["type"] == "event"]


def find_missing(events):
    """The first that does not follow; None if all do."""
    rest = iter(sorted(events, key=lambda event: event["t_s"]))
    for source, code in FOLLOWS:
        if not any(event["source"] == source and event["code"] == code for event in rest):
            return f"{source}: {code}"
    return None


def main(meltbench):
    with tempfile.TemporaryDirectory() as folder:
        plant_port = f"{folder}/plant"
        adapter = Adapter(f"{folder}/adapter")
        run = subprocess.Popen([meltbench, "run", SCENARIO, "--quiet", "--out", f"{folder}/out",
                                "--line", f"dosing=pty:{plant_port}", "--controller-line", f"dosing={adapter.name}"])
        while not os.path.islink(plant_port) and run.poll() is None:
            time.sleep(0.01)
        plant = os.open(plant_port, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(plant)
        begun = None
        steps = [(UNPLUGGED_S, adapter.unplug), (PLUGGED_S, adapter.plug)]
        while run.poll() is None:
            ends = [plant] + ([adapter.master] if adapter.master is not None else [])
            for end in select.select(ends, [], [], 0.02)[0]:
                carry(end, adapter.master if end == plant else plant)
            if begun is None and any(event["code"] == "running" for event in read_events(folder)):
                begun = time.monotonic()
            if steps and begun is not None and time.monotonic() - begun > steps[0][0]:
                steps.pop(0)[1]()
        events = read_events(folder)
    missing = find_missing(events)
    for event in events:
        if missing or (event["source"], event["code"]) in FOLLOWS:
            print(f"{event['t_s']:.3f} s  {event['source']}: {event['text']} [{event['code']}]")
    if missing:
        print(f"failed: not seen in its turn: {missing}")
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
