"""Judges what the guests of the kernel lane left: writes junit.xml and summary.txt, prints both in words.

Usage: judge.py OUT. Exit status 1 if anything failed.

Each step of a guest is a test, and so is each scenario run: it must have the same verdicts as the same scenario on the
embedded bus. In instruction-counted time the timing checks count, too, and the run is compared with the embedded one
sample by sample. In plain time the host decides when the guest may run; timing checks are then left out.
"""

import csv
import json
import pathlib
import re
import sys
import xml.etree.ElementTree as xml

TIMING_KINDS = {"frame_period", "frame_jitter", "reaction"}
# What the health gate finds when a program ran too late; in plain time that is the host's doing.
TIMING_FINDING = re.compile(r"(tpdos_missed|syncs_missed|deadline_misses|deadline misses)")
# Half of the shortest watchdog of the boards: a host that holds a guest for longer than this decides the verdict.
DISTURBED_S = 0.025

MAX_SYNC_DEVIATION_S = 150e-6  # p99.9
MAX_REACTION_S = 1e-3  # p99
MAX_TRAJECTORY_DIFFERENCE_M = 0.2e-3
SYNC_PERIOD_S = 0.010


class Tally:
    def __init__(self):
        self.suite = xml.Element("testsuite", name="kernel")
        self.counts = {"passed": 0, "failed": 0, "skipped": 0}
        self.lines = []

    def add(self, name, outcome, text="", seconds=None):
        """outcome: passed, failed, skipped."""
        self.counts[outcome] += 1
        case = xml.SubElement(self.suite, "testcase", classname="kernel", name=name)
        if seconds is not None:
            case.set("time", f"{seconds:.1f}")
        if outcome == "passed":
            xml.SubElement(case, "system-out").text = text
        else:
            xml.SubElement(case, "failure" if outcome == "failed" else "skipped", message=text.split("\n")[0]).text = text
        self.lines.append(f"{outcome:<8}{name}{': ' + text if text else ''}")

    def write(self, out):
        self.suite.set("tests", str(sum(self.counts.values())))
        self.suite.set("failures", str(self.counts["failed"]))
        self.suite.set("skipped", str(self.counts["skipped"]))
        xml.ElementTree(self.suite).write(out / "junit.xml", encoding="utf-8", xml_declaration=True)
        self.lines.append(", ".join(f"{count} {what}" for what, count in self.counts.items()))
        (out / "summary.txt").write_text("\n".join(self.lines) + "\n")
        print("\n".join(self.lines))


def load_result(folder):
    return json.loads((folder / "result.json").read_text())


def read_signals(folder):
    """One dictionary of numbers per row."""
    with open(folder / "signals.csv", newline="") as file:
        return [{name: float(text) for name, text in row.items()} for row in csv.DictReader(file)]


def read_frames(folder):
    """(time in s, identifier) of all frames of bus.log."""
    line = re.compile(r"\((\d+\.\d+)\) \S+ ([0-9A-F]+)#")
    with open(folder / "bus.log") as file:
        found = (line.match(text) for text in file)
        return [(float(match[1]), int(match[2], 16)) for match in found if match]


def percentile(values, share):
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(len(ordered) * share))]


def sync_deviations(frames):
    times = [at for at, cob_id in frames if cob_id == 0x080]
    return [abs(after - before - SYNC_PERIOD_S) for before, after in zip(times, times[1:])]


def reactions(frames):
    """From the last sample that the law needs to the set point that it makes of it, per SYNC cycle."""
    needed = {0x185, 0x386, 0x187}
    found, seen, last = [], set(), None
    for at, cob_id in frames:
        if cob_id == 0x080:
            seen, last = set(), None
        elif cob_id in needed:
            seen.add(cob_id)
            last = at
        elif cob_id == 0x205 and seen == needed and last is not None:
            found.append(at - last)
            last = None
    return found


def verdicts(result, with_timing):
    """{name of the check: held}. Without timing: only what does not depend on when the programs may run."""
    found = {}
    for check in result["checks"]:
        if check["kind"] == "health":
            findings = result["health"]["findings"]
            found["health"] = not [text for text in findings if with_timing or not TIMING_FINDING.search(text)]
        elif with_timing or check["kind"] not in TIMING_KINDS:
            found[check["name"]] = check["held"]
    return found


def explain(result, names):
    return "\n".join(f"{check['name']}: {check['text']}" for check in result["checks"] if check["name"] in names)


def worst_lateness_s(result):
    return max((values["max"] for name, values in result["signals"].items() if name.endswith(".worst_lateness_s")), default=0.0)


def judge_run(tally, name, embedded, folder, with_timing):
    """Same verdicts as on the embedded bus."""
    if not (folder / "result.json").is_file():
        return tally.add(name, "failed", "this run did not take place")
    result = load_result(folder)
    wanted, found = verdicts(load_result(embedded), with_timing), verdicts(result, with_timing)
    differing = [check for check in wanted if found.get(check) != wanted[check]]
    lateness_s = worst_lateness_s(result)
    if not differing:
        return tally.add(name, "passed", f"{len(wanted)} verdicts as on the embedded bus; latest wake-up {1e3 * lateness_s:.2f} ms")
    text = explain(result, differing)
    if not with_timing and lateness_s > DISTURBED_S:
        return tally.add(name, "skipped", f"the host held the guest for {1e3 * lateness_s:.0f} ms, no verdict: {text}")
    return tally.add(name, "failed", text)


def judge_figure(tally, name, found, allowed, scale, unit):
    outcome = "passed" if found < allowed else "failed"
    tally.add(name, outcome, f"{scale * found:.4g} {unit}; must be below {scale * allowed:.4g} {unit}")


def judge_timing(tally, name, folder):
    frames = read_frames(folder)
    judge_figure(tally, f"{name}, SYNC period of 10 ms, p99.9 of its deviation",
                 percentile(sync_deviations(frames), 0.999), MAX_SYNC_DEVIATION_S, 1e6, "us")
    judge_figure(tally, f"{name}, last sample to command, p99",
                 percentile(reactions(frames), 0.99), MAX_REACTION_S, 1e3, "ms")


def judge_trajectory(tally, name, embedded, folder):
    pairs = zip(read_signals(embedded), read_signals(folder))
    judge_figure(tally, f"{name}, filled length against lockstep, largest difference",
                 max(abs(a["plant.x_m"] - b["plant.x_m"]) for a, b in pairs), MAX_TRAJECTORY_DIFFERENCE_M, 1e3, "mm")


def judge_suite(tally, out, guest, step):
    runs = out / guest / step / "runs"
    for file in sorted((out / "embedded").rglob("result.json")):
        label = file.parent.relative_to(out / "embedded")
        if not (runs / label.parts[0]).is_dir():
            continue  # A shorter suite.
        folder = runs / label
        name = f"{guest} {step} {label}"
        judge_run(tally, name, file.parent, folder, guest != "plain")
        if guest != "plain" and label.name == "trajectory" and (folder / "bus.log").is_file():
            judge_timing(tally, name, folder)
            if step == "suite_vcan":  # Frames cross at once there, as on the embedded bus.
                judge_trajectory(tally, name, file.parent, folder)


def judge_guest(tally, out, guest):
    died = out / guest / "died"
    if died.is_file():
        console = (out / guest / "console.log").read_text(errors="replace")
        tally.add(f"{guest} guest", "failed", died.read_text() + console[-4000:])
    steps = out / guest / "steps"
    for line in steps.read_text().splitlines() if steps.is_file() else []:
        step, status, seconds = line.split()
        printed = (out / guest / step / "output.txt").read_text(errors="replace").strip()
        last = printed.split("\n")[-1]
        if status == "0":
            tally.add(f"{guest} {step}", "passed", seconds=float(seconds))
        elif status == "77":
            tally.add(f"{guest} {step}", "skipped", last, float(seconds))
        else:
            tally.add(f"{guest} {step}", "failed", f"status {status}\n{printed[-4000:]}", float(seconds))
        if step.startswith("suite_"):
            judge_suite(tally, out, guest, step)


def main():
    out = pathlib.Path(sys.argv[1])
    tally = Tally()
    for guest in ("counted", "cards", "plain"):
        if (out / guest).is_dir():
            judge_guest(tally, out, guest)
    tally.write(out)
    sys.exit(1 if tally.counts["failed"] else 0)


if __name__ == "__main__":
    main()
