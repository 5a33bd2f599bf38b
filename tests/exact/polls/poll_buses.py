"""Scenarios with poll lists."""

from __future__ import annotations

import random
from dataclasses import replace

from bussim.devices.contract import BusDevice
from bussim.devices.lx.model import LxSettings
from bussim.devices.map.map import Entry
from bussim.devices.map.model import MapSettings
from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.pdu import FUNCTIONS
from bussim.engines.modbus.server import Space
from bussim.exact.polls.from_scenario import poll_lists
from bussim.exact.polls.metrics import PollFigures, poll_figures
from bussim.line.characters import CharFormat, LineTiming
from bussim.plc.memory import parse_device
from bussim.plc.ports.spec import PollSpec
from bussim.scenario import model
from tests.sim.build import MS
from tests.sim.serial import MASTER, SLAVE, device, hmi, plc, port, serial_bus

WORDS = MapSettings((Entry(Space.HOLDING, 0, count=200, writable=True),), FUNCTIONS)


def station(name: str = "feeder", number: int = 1, **given: object) -> BusDevice:
    return device(name, "map", number, settings=WORDS, **given)


def ask(name: str = "a", number: int = 1, *, to: str | None = "D400", **given: object) -> PollSpec:
    values: dict[str, object] = {"function": 3, "address": 0, "count": 2, **given}
    device = parse_device(to) if to else None
    return PollSpec(name, "COM3", number, device=device, **values)  # type: ignore[arg-type]


def figures(scenario: model.Scenario) -> dict[str, PollFigures]:
    return {node: poll_figures(found) for node, found in poll_lists(scenario).items()}


def only(scenario: model.Scenario) -> PollFigures:
    (found,) = figures(scenario).values()
    return found


# -- against the simulation ---------------------------------------------------------------------------

LINES = [
    (LineTiming(baud, CharFormat.parse(text)), Mode.RTU)
    for baud in (4800, 9600, 19200, 38400, 115200)
    for text in ("8N1", "8E1", "8N2")
]


LINES += [(LineTiming(9600, CharFormat.parse("7E1")), Mode.ASCII)]


def random_bus(seed: int) -> model.Scenario:
    """A master (a PLC or an HMI) with random polls of random slaves."""
    rng = random.Random(seed)
    timing, mode = rng.choice(LINES)
    slaves: list[BusDevice] = []
    plcs: list[model.Plc] = []
    given = {"timing": timing, "mode": mode}
    for number in range(1, rng.randint(2, 4)):
        kind = rng.choice(["map", "map", "lx", "plc", "stepper"])
        if kind == "stepper" and mode is Mode.RTU and str(timing.format) == "8N1" and timing.baud != 57600:
            slaves.append(device(f"s{number}", "stepper", number, **given))
        elif kind == "lx":
            scan = model.Scan(rng.randint(1, 9) * MS, rng.choice([0, MS // 2]))
            slaves.append(device(f"s{number}", "lx", number, settings=LxSettings(scan), **given))
        elif kind == "plc":
            words = {"form": form(timing)}
            slave = SLAVE if mode is Mode.RTU else "modbus-ascii-slave"
            own = port("COM4", slave, station=number, **words)
            plcs.append(plc(f"q{number}", own, scan=rng.randint(1, 9) * MS, jitter=rng.choice([0, MS // 2])))
        else:
            delay, jitter = rng.choice([(0, 0), (4 * MS, 0), (2 * MS, 6 * MS)])
            slaves.append(station(f"s{number}", number, delay=delay, jitter=jitter, **given))
    stations = len(slaves) + len(plcs)
    every = rng.choice([[0], [0], [200 * MS], [700 * MS], [0, 300 * MS], [150 * MS, 400 * MS, 900 * MS]])
    specs = []
    for number in range(rng.randint(1, 5)):
        function, count = rng.choice([(3, 1), (3, 10), (6, 1), (16, 4), (3, 30)])
        specs.append(
            ask(
                f"p{number}",
                rng.randint(1, stations),
                to=None,
                function=function,
                address=rng.choice([0, 2]) if function == 3 else 8,
                count=count,
                values=(1,) * count if function != 3 else (),
                every=rng.choice(every),
                retries=rng.randint(0, 2),
                times=3 if rng.random() < 0.1 else None,
            )
        )
    if rng.random() < 0.3:
        polls = tuple(replace(spec, port="") for spec in specs)
        interval = rng.choice([0, 5, 40]) * MS
        master = hmi("panel", *polls, timeout=600 * MS, interval=interval, **given)
        return serial_bus([*slaves, master], plcs, seconds=20, seed=seed, timing=timing)
    words = {"form": form(timing), "interval": rng.choice([0, 10, 300])}
    protocol = MASTER if mode is Mode.RTU else "modbus-ascii-master"
    own = port("COM3", protocol, timeout=60, **words)
    mean = rng.randint(1, 12) * MS
    plcs.append(plc("press", own, polls=specs, scan=mean, jitter=rng.choice([0, mean // 8, mean // 2])))
    return serial_bus(slaves, plcs, seconds=20, seed=seed, timing=timing)


def form(timing: LineTiming) -> int:
    from bussim.plc.ports.cpavl import format_word

    return format_word(timing, eight_bit=False)


# -- with errors --------------------------------------------------------------------------------------


def four_polls(**given: object) -> model.Scenario:
    polls = [ask(name, retries=3, to=None, every=given.get("every", 0)) for name in "abcd"]
    press = plc("press", port("COM3", MASTER, timeout=10), polls=polls, jitter=MS)
    return serial_bus([station()], [press], seconds=60)


# -- where there are no figures -----------------------------------------------------------------------


def reasons(scenario: model.Scenario, node: str = "press.COM3") -> str:
    found = figures(scenario)[node]
    assert not found.model.valid
    form = found.to_json()
    assert form["valid"] is False
    assert set(form["cycle_ms"].values()) == {None}  # type: ignore[attr-defined]
    assert (form["worst_case_ms"], form["polls"], form["dead"]) == (None, {}, {})
    assert all(sentence.startswith("no figures: ") for sentence in found.in_words())
    return "; ".join(found.model.obstacles)


def with_polls(
    *polls: PollSpec, devices: tuple[BusDevice, ...] = (station(),), **words: int
) -> model.Scenario:
    return serial_bus(devices, [plc("press", port("COM3", MASTER, **words), polls=polls)], seconds=5)
