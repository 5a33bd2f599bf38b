"""Commands ended by signals at random moments, and pairs of commands with one target; run by hand.

``python -m tests.killing kill [MOMENTS [COMMAND ...]]`` ends each command by SIGINT, SIGTERM and SIGKILL at so many moments
and prints a table: what the exit codes were, and whether anything was half written, left or still running.
``python -m tests.killing pairs [COUNT [COMMAND ...]]`` starts so many pairs at once and compares what is there with each alone.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from random import Random

ROOT = Path(__file__).parents[1]
LONG = ["two_stations", "--duration", "20h"]
#: Words of each command; A and B are runs, each OUT is a target.
COMMANDS: dict[str, list[str]] = {
    "run": ["run", *LONG, "--trace", "--out", "OUT"],
    "check": ["check", *["nn_with_modbus", "manual_programs", "press_line"] * 8],
    "exact": ["exact", "eight_stations_mode2", "--plot", "--out", "OUT.png"],
    "size": ["size", "press_line", "--out", "OUT"],
    "watch": ["watch", "interlock", "--devices", "press1.D8201", "--csv", "OUT.csv"],
    "sweep": ["sweep", *LONG, "--vary", "seed=1,2,3,4", "--workers", "2", "--out", "OUT"],
    "new": ["new", "-o", "OUT.yaml"],
    "scenarios": ["scenarios", "two_stations", "--copy", "OUT.yaml"],
    "plot": ["plot", "A", "--out", "OUT"],
    "timeline": ["timeline", "A", "--out", "OUT.png"],
    "export": ["export", "A", "--to", "vcd", "-o", "OUT.vcd"],
    "report": ["report", "A", "-o", "OUT.html"],
    "sniff": ["sniff", "A", "--out", "OUT"],
    "fit": ["fit", "A", "-o", "OUT.yaml"],
    "serve": ["serve", "nn_with_modbus", "feeder1", "--out", "OUT"],
    "poll": ["poll", "pty", "-l", "100"],
    "inject": ["inject", "feeder1", "drop_reply"],
    "ui": ["ui", "two_stations", "--no-browser"],
    "site": ["site", "R.yaml"],
    "guide": ["guide", "model"],
}
PAIRS: dict[str, tuple[str, ...]] = {
    "export": ("export", "?", "--to", "vcd", "-o", "OUT.vcd", "--force"),
    "plot": ("plot", "?", "--out", "OUT", "--force"),
    "report": ("report", "?", "-o", "OUT.html", "--force"),
    "sweep": ("sweep", "two_stations", "--duration", "2s", "--vary", "?", "--workers", "1", "--out", "OUT", "--force"),
}  # fmt: skip


def started(words: list[str], folder: Path, group: bool = True) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "bussim", *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), "XDG_RUNTIME_DIR": str(folder)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=group,
    )


def alive(group: int) -> bool:
    """Whether a process of a group is still there."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def left(folder: Path, before: set[str]) -> set[str]:
    """Names that a command added, without its whole results."""
    names = {path.name for path in folder.iterdir()} - before
    names -= {"bussim"}  # of control sockets, in the folder that stands for the user's runtime folder
    return {name for name in names if not name.startswith("OUT") or name.endswith((".part", ".incomplete"))}


def kill(moments: int, folder: Path, names: Sequence[str]) -> None:
    for name in ("A", "B"):
        started(["run", "two_stations", "--duration", "20s", "--trace", "--out", name, "--set", f"seed={ord(name)}"], folder).wait()  # fmt: skip
    started(["run", "two_stations", "--duration", "2s", "--out", "C", "--readout", "R.yaml"], folder).wait()
    random, before = Random(1), {path.name for path in folder.iterdir()}
    print("command    signal   done before  codes  words that are none of ours  left behind  still running")
    for name in names:
        words = COMMANDS[name]
        begun = time.monotonic()
        process = started(words, folder)
        try:
            process.wait(8)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        lasts = time.monotonic() - begun
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            codes, odd, remains, running, done = Counter[int](), Counter[str](), Counter[str](), 0, 0
            for _ in range(moments):
                for path in folder.iterdir():
                    if path.name not in before:
                        shutil.rmtree(path) if path.is_dir() else path.unlink()
                process = started(words, folder)
                time.sleep(random.uniform(0, lasts))
                done += process.poll() is not None
                process.send_signal(number)
                _, said = process.communicate()
                codes[process.returncode] += 1
                if "Traceback" in said or "Warning" in said:
                    odd[said[-300:]] += 1
                if number != signal.SIGKILL:
                    remains.update(left(folder, before))
                until = time.monotonic() + 5
                while alive(process.pid) and time.monotonic() < until:
                    time.sleep(0.05)
                if alive(process.pid):
                    running += 1
                    os.killpg(process.pid, signal.SIGKILL)
            print(
                f"{name:10} {number.name:8} {done:5} {dict(codes)} {dict(odd)} {dict(remains)} {running}",
                flush=True,
            )


def content(path: Path) -> dict[str, str]:
    """Digests of a file, or of the files of a folder, by their names; of a sweep only of its tables."""
    files = [path] if path.is_file() else [each for each in path.rglob("*") if each.is_file()]
    kept = [each for each in files if each.suffix in (".csv", ".html", ".png", ".svg", ".vcd")]
    return {each.name: hashlib.sha256(each.read_bytes()).hexdigest() for each in kept}


def whose(found: dict[str, str], alone: list[dict[str, str]]) -> str:
    """Whose the files are: A, B, or both where some whole files are the one's and some the other's."""
    for name, other in zip("AB", alone, strict=True):
        if found == other:
            return name
    whole = all(digest in (one.get(name) for one in alone) for name, digest in found.items())
    return "files of both, each whole" if whole else "neither"


def pairs(count: int, folder: Path, names: Sequence[str]) -> None:
    for name in ("A", "B"):
        started(["run", "two_stations", "--duration", "20s", "--trace", "--out", name, "--set", f"seed={ord(name)}"], folder).wait()  # fmt: skip
    for name in names:
        words = PAIRS[name]
        both = ("seed=1,2", "seed=3,4") if name == "sweep" else ("A", "B")
        target = next(folder / word for word in words if word.startswith("OUT"))
        alone = []
        for one in both:
            started([one if word == "?" else word for word in words], folder).communicate()
            alone.append(content(target))
        results, codes, said = Counter[str](), Counter[tuple[int, ...]](), Counter[str]()
        for _ in range(count):
            two = [started([one if word == "?" else word for word in words], folder) for one in both]
            texts = [process.communicate()[1] for process in two]
            codes[tuple(sorted(process.returncode for process in two))] += 1
            results[whose(content(target), alone)] += 1
            for text in texts:
                said[text.strip().replace(str(folder), "").split(" (bussim-")[0][-90:] or "nothing"] += 1
        rest = [path.name for path in folder.iterdir() if path.suffix in (".part", ".incomplete")]
        print(f"{name}: {dict(results)}, codes {dict(codes)}, left {rest}", flush=True)
        for text, number in said.most_common():
            print(f"  {number:3} said {text}", flush=True)


if __name__ == "__main__":
    # A shell's background job ignores Ctrl-C, and so would all that it starts.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    todo = parser.add_subparsers(required=True)
    for function, count, known in ((kill, 30, COMMANDS), (pairs, 16, PAIRS)):
        asked = todo.add_parser(function.__name__)
        asked.add_argument("count", nargs="?", type=int, default=count)
        asked.add_argument("names", nargs="*", metavar="COMMAND", default=[*known], help=", ".join(known))
        asked.set_defaults(function=function)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        given.function(given.count, Path(place), given.names)
