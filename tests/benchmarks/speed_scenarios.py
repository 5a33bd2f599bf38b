"""The scenarios whose speed is measured, and the lean loop that it is measured against."""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Sequence

import simpy

from bussim.scenario import model
from bussim.scenario.loader import loads

STATIONS = 8


def lean_loop(events: int) -> float:
    """The processor seconds of so many events of a bare SimPy loop: one that is armed again, a random draw."""
    env, draw, left = simpy.Environment(), random.Random(1).random, events
    event = simpy.Event(env)
    event._ok, event._value = True, None

    def again(event: simpy.Event) -> None:
        nonlocal left
        event.callbacks = callbacks
        left -= 1
        if left:
            env.schedule(event, delay=int(1000 + draw() * 100))

    callbacks: list[Callable[[simpy.Event], None]] = [again]
    event.callbacks = callbacks
    env.schedule(event, delay=1)
    begun = time.process_time()
    env.run()
    return time.process_time() - begun


def link(
    *noise: str,
    stations: int = STATIONS,
    plc: Sequence[str] = (),
    profile: str = "pw10",
    seconds: int = 86400,
) -> str:
    """A link in mode 2; ``noise`` are its kinds, ``plc`` further lines of each PLC, ``{n}`` its station."""
    lines = ["schema: 1", f"name: speed\nduration: {seconds} s", "buses: [{name: link, nn: true}]", "plcs:"]
    for station in range(stations):
        master = f", slaves: {stations - 1}, mode: 2, retries: 3, timeout: 100 ms" if not station else ""
        lines += [
            f"  - name: plc{station}",
            f"    profile: {profile}",
            "    scan: {mean: 8 ms, jitter: 1 ms}",
            f"    nn: {{bus: link, port: COM4, station: {station}{master}}}",
            *(f"    {line}".format(n=station, m=1000 + 64 * station, d=32 * station) for line in plc),
        ]
    return "\n".join([*lines, "noise:" if noise else "", *(f"  - {{bus: link, {kind}}}" for kind in noise)])


_PROGRAM = ("program: |", "  LD X0", "  OUT M{m}", "  END")
_POLLS = (
    "ports: {{COM3: {{bus: bus{n}, protocol: modbus-rtu-master}}}}",
    "polls:",
    "  - {{port: COM3, station: 1, function: 3, address: 0, count: 4, to: D{d}, every: 200 ms}}",
    "  - {{port: COM3, station: 2, function: 3, address: 0, count: 2, to: D{d}, every: 200 ms}}",
)


def _with_ports(masters: int) -> str:
    """A link whose first PLCs each poll two devices on a bus of their own."""
    plain = link(stations=4).split("  - name: plc")
    for station in range(masters):
        more = "\n".join(f"    {line}".format(n=station, d=400 + station) for line in _POLLS)
        plain[station + 1] = f"{plain[station + 1].rstrip()}\n{more}\n"
    buses = "".join(f", {{name: bus{n}}}" for n in range(masters))
    devices = "".join(
        f"\n  - {{name: drive{n}, model: stepper, bus: bus{n}, station: 1}}"
        f"\n  - {{name: meter{n}, model: v80, bus: bus{n}, station: 2}}"
        for n in range(masters)
    )
    text = "  - name: plc".join(plain).replace("nn: true}]", f"nn: true}}{buses}]")
    return f"{text}\ndevices:{devices}"


LOSS = "reply_loss: 1.0e-3"
#: The scenarios by mark; every one is of a day.
TEXTS: dict[str, str] = {
    "W": link(LOSS),
    "no noise": link(),
    "ber 1e-6": link("ber: 1.0e-6"),
    "ber 1e-5": link("ber: 1.0e-5"),
    "reply_loss 1e-2": link("reply_loss: 1.0e-2"),
    "sources": link(LOSS, plc=["sources: {{D{d}: {{counter: 1 s}}}}"]),
    "CSV rows": link(LOSS),
    "Parquet rows": link(LOSS),
    "trace": link(LOSS),
    "two stations": link(stations=2),
    "programs": link(LOSS, plc=[*_PROGRAM, "inputs: {{X0: {{square: 400 ms}}}}"]),
    "programs at rest": link(LOSS, plc=_PROGRAM),
    "four ports": _with_ports(4),
    "replies at END": link(profile="{{base: pw10, reply: end}}".replace("{{", "{").replace("}}", "}")),
}


def scenario(mark: str) -> model.Scenario:
    """The scenario of a mark."""
    return loads(TEXTS[mark])
