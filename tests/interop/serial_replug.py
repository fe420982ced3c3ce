"""A serial adapter that is unplugged in mid-run and plugged in again, as another device behind the same name.

The feeder's line is two pseudo-terminals with this program as the cable between them. Unplugging closes the
controller's; plugging in moves its name, a link as udev makes them, to a new one with another minor number.
Usage: serial_replug.py MELTBENCH.
"""
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
UNPLUGGED_S, PLUGGED_S = 2.0, 3.0  # Since the plant's port is there; the run takes 6 s.


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
    except OSError:  # Nobody has the other end open yet.
        time.sleep(0.005)
        return
    if target is not None:
        os.write(target, data)


def main(meltbench):
    with tempfile.TemporaryDirectory() as folder:
        plant_port = f"{folder}/plant"
        adapter = Adapter(f"{folder}/adapter")
        run = subprocess.Popen([meltbench, "run", SCENARIO, "--out", f"{folder}/out",
                                "--line", f"dosing=pty:{plant_port}", "--controller-line", f"dosing={adapter.name}"])
        while not os.path.islink(plant_port) and run.poll() is None:
            time.sleep(0.01)
        plant = os.open(plant_port, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(plant)
        begun = time.monotonic()
        steps = [(UNPLUGGED_S, adapter.unplug), (PLUGGED_S, adapter.plug)]
        while run.poll() is None:
            ends = [plant] + ([adapter.master] if adapter.master is not None else [])
            for end in select.select(ends, [], [], 0.02)[0]:
                carry(end, adapter.master if end == plant else plant)
            if steps and time.monotonic() - begun > steps[0][0]:
                steps.pop(0)[1]()
        return run.returncode


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
