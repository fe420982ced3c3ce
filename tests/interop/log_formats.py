"""Logs of all kinds of frames, there and back between `meltbench convert` and other people's programs."""

import random
import subprocess
import sys

import can

MELTBENCH, FOLDER = sys.argv[1:]
START = 1772368496.789  # 2026-03-01 12:34:56.789 UTC
FD_LENGTHS = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64]


def make_messages(count, with_fd=True):
    draw = random.Random(5)
    at = START
    for _ in range(count):
        at += draw.randrange(1, 5000) * 1e-6
        extended = draw.random() < 0.5
        kind = draw.random()
        common = dict(
            timestamp=round(at, 6),
            arbitration_id=draw.randrange(1 << (29 if extended else 11)),
            is_extended_id=extended,
            channel=draw.randrange(2),
            is_rx=True,
        )
        if kind < 0.1:
            yield can.Message(is_remote_frame=True, dlc=draw.randrange(9), **common)
        elif kind < 0.3 and with_fd:
            data = bytes(draw.randrange(256) for _ in range(draw.choice(FD_LENGTHS[1:])))
            yield can.Message(is_fd=True, bitrate_switch=draw.random() < 0.5, data=data, **common)
        else:
            yield can.Message(data=bytes(draw.randrange(256) for _ in range(draw.randrange(9))), **common)


def facts(message):
    return (
        message.arbitration_id,
        message.is_extended_id,
        message.is_remote_frame,
        message.is_fd,
        message.bitrate_switch,
        bytes(message.data),
    )


def read(path, **options):
    reader = {"asc": can.ASCReader, "blf": can.BLFReader, "log": can.CanutilsLogReader}[path.rsplit(".", 1)[1]]
    return list(reader(path, **options))


def convert(source, target):
    subprocess.run([MELTBENCH, "convert", source, target], check=True, stdout=subprocess.DEVNULL)


def require_equal(what, found, expected, tolerance_s):
    assert len(found) == len(expected), f"{what}: {len(found)} frames instead of {len(expected)}"
    for number, (one, other) in enumerate(zip(found, expected)):
        assert facts(one) == facts(other), f"{what}: frame {number}: {one} instead of {other}"
        late = abs((one.timestamp - found[0].timestamp) - (other.timestamp - expected[0].timestamp))
        assert late <= tolerance_s, f"{what}: frame {number} is off by {late} s"
    print(f"{what}: {len(found)} frames")


def main():
    messages = list(make_messages(3000))
    kinds = {"log": can.CanutilsLogWriter, "asc": can.ASCWriter, "blf": can.BLFWriter}
    for source, writer in kinds.items():
        path = f"{FOLDER}/python.{source}"
        with writer(path) as log:
            for message in messages:
                log.on_message_received(message)
        for target in kinds:
            ours = f"{FOLDER}/{source}_to.{target}"
            convert(path, ours)
            # Stamps have microseconds; python-can computes them in floating point.
            require_equal(f"python3-can {source} -> convert -> {target} -> python3-can", read(ours), messages, 2.1e-6)

    log = f"{FOLDER}/asc_to.log"
    for path in (log, f"{FOLDER}/log_to.blf"):
        lines = subprocess.run(["tshark", "-r", path], check=True, capture_output=True, text=True).stdout
        assert len(lines.splitlines()) == len(messages), f"tshark reads {len(lines.splitlines())} frames of {path}"
        print(f"tshark {path.rsplit('.', 1)[1]}: {len(messages)} frames")

    with open(f"{FOLDER}/can_utils.asc", "w") as asc:
        subprocess.run(["log2asc", "-I", log, "can0", "can1"], check=True, stdout=asc)
    convert(f"{FOLDER}/can_utils.asc", f"{FOLDER}/can_utils.log")
    require_equal("log2asc -> convert -> python3-can", read(f"{FOLDER}/can_utils.log"), messages, 2.1e-6)


main()
