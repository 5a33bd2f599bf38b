"""How fast a served Modbus slave responds on a pseudo-terminal, and how often.

    python tests/benchmarks/bench_serve.py [SECONDS]

A V80 without a delay at 115200 8N1 (RTU), served by a process of its own. The master here writes each
request in one go and waits for the reply: what is measured is the served side and the system, not a
client library. The silence that ends a request is 4.5 characters for a V80 (its manual) and 1.75 ms for
a device that keeps to the standard, so both are measured.

Then an N:N link between its two halves, a process each, paced: the link scan times that the master
measures beside those that the simulation gives. Nothing is asserted: a time is no test's verdict.
"""

from __future__ import annotations

import json
import os
import select
import statistics
import subprocess
import sys
import tempfile
import time
import tty
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

import bussim  # noqa: E402 (after the path)
from bussim.engines.modbus.adu import Mode, encode_adu  # noqa: E402 (after the path)

SCENARIO = """\
schema: 1
name: bench
duration: 1 h
buses: [{name: line, baud: 115200, format: 8N1}]
plcs: [{name: plc, scan: 5 ms}]
devices:
  - {name: v80, model: v80, bus: line, station: 1, delay: 0 ms}
  - {name: plain, model: map, bus: line, station: 2, delay: 0 ms, registers: [{address: 0, count: 10}]}
"""
#: Milliseconds of silence that end a request.
SILENCES = {1: 4.5 * 10 / 115.2, 2: 1.75}
RESPONSE = 25


def measure(device: str, station: int, seconds: float) -> list[float]:
    """Milliseconds from each request to the whole response."""
    request = encode_adu(Mode.RTU, station, bytes((3, 0, 0, 0, 10))).chars
    handle = os.open(device, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(handle)
    times: list[float] = []
    until = time.perf_counter() + seconds
    while time.perf_counter() < until:
        begun = time.perf_counter()
        os.write(handle, request)
        response = b""
        while len(response) < RESPONSE:
            ready, _, _ = select.select((handle,), (), (), 2.0)
            if not ready:
                raise SystemExit(f"no response to request {len(times)}: {response.hex()}")
            response += os.read(handle, 256)
        times.append((time.perf_counter() - begun) * 1000)
    os.close(handle)
    return times


def serve(*words: str, output: int = subprocess.DEVNULL) -> subprocess.Popen[bytes]:
    """Start a process that serves, and wait until it does."""
    command = [sys.executable, "-m", "bussim", "serve", *words, "--json"]
    process = subprocess.Popen(command, cwd=ROOT, stdout=output, stderr=subprocess.PIPE)
    assert process.stderr is not None
    while b"Ctrl-C" not in (line := process.stderr.readline()):
        if not line:
            raise SystemExit("it does not serve")
    return process


def halves(folder: Path, seconds: float) -> None:
    """Measure the link scan time of two halves on one wire."""
    scenario, link = "two_stations", folder / "link"
    slaves = serve(scenario, f"--port=feeder=pty:{link}", "--paced")
    settings = ("--set", "plcs.press.nn.timeout=2250 ms", "--for", f"{seconds} s", "--tolerance", "1 s")
    master = serve(scenario, f"--port=press={link}", "--paced", *settings, output=subprocess.PIPE)
    out, _ = master.communicate(timeout=seconds + 60)
    slaves.send_signal(2)
    slaves.wait(30)
    measured = json.loads(out)["links"]["link"]
    expected = bussim.run(scenario).summary["links"]["link"]
    for name, found in (("two halves, paced", measured), ("simulated", expected)):
        times = found["scan_time_ms"]
        print(
            f"link scan, {name}: p50 {times['p50']} ms, mean {times['mean']:.3f} ms, "
            f"{times['min']:.3f} to {times['max']:.3f} ms, {found['scans']} scans"
        )


def main() -> None:
    """Measure and print."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 5.0
    with tempfile.TemporaryDirectory() as folder:
        scenario, link = Path(folder) / "bench.yaml", Path(folder) / "line"
        scenario.write_text(SCENARIO, encoding="utf-8")
        ports = [f"--port=v80=pty:{link}", f"--port=plain=pty:{link}"]
        process = serve(str(scenario), *ports)
        try:
            for station, silence in SILENCES.items():
                measure(str(link), station, 0.5)
                times = measure(str(link), station, seconds)
                middle = statistics.median(times)
                late = sorted(times)[int(len(times) * 0.99)]
                print(
                    f"station {station}, silence {silence:.3f} ms: {len(times) / (sum(times) / 1000):.0f} "
                    f"transactions/s; response median {middle:.3f} ms = silence + {middle - silence:.3f} ms, "
                    f"99 % {late:.3f} ms, longest {max(times):.3f} ms"
                )
        finally:
            process.send_signal(2)
            process.wait(30)
        halves(Path(folder), seconds)


if __name__ == "__main__":
    main()
