"""Whole transactions at once: everything is as if each frame and silence had its event."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from random import Random

import pytest

from bussim.devices.contract import BusDevice
from bussim.engines.modbus.gaps import GapRule
from bussim.line.characters import CharFormat, LineTiming
from bussim.scenario import fault_kinds, model
from bussim.scenario.loader import loads
from bussim.sim.serial.transaction_path import TransactionPath
from bussim.sim.serial.turn_path import TurnPath
from tests.benchmarks.speed_scenarios import scenario as speed
from tests.exact.polls.test_polling import random_bus
from tests.selection import quick
from tests.sim.build import MS, SECOND, Done, run, started
from tests.sim.test_rest import compare, left, one_by_one

SECONDS = 3
OTHER = LineTiming(19200, CharFormat(8, "E", 1))


def _kind(rng: Random, node: str, plcs: list[str]) -> fault_kinds.FaultKind:
    direction, count = rng.choice(list(fault_kinds.Direction)), rng.choice([None, 1, 3])
    unit = node.partition(".")[0]
    kinds = [
        fault_kinds.PowerOff(unit),
        fault_kinds.Stop(rng.choice(plcs)) if plcs else fault_kinds.PowerOff(unit),
        fault_kinds.DropReply(node, count),
        fault_kinds.Slow(node, rng.randint(1, 90) * MS),
        fault_kinds.Jabber(node),
        fault_kinds.CableCut("bus", node),
        fault_kinds.WrongFormat(node, OTHER),
        fault_kinds.ClockPpm(node, Fraction(rng.choice([-60_000, 200]))),
        fault_kinds.LateRelease(node, rng.choice([1000, 90_000, 400_000])),
        fault_kinds.LoseChar(node, direction, count),
        fault_kinds.InsertChar(node, direction, count),
        fault_kinds.Pause(node, 90_000, count),
        fault_kinds.FlipBits(node, direction, (rng.randrange(90),), count),
    ]
    return rng.choice(kinds)


def _hurried(device: BusDevice, timeout: int) -> BusDevice:
    settings = device.settings
    return replace(device, settings=replace(settings, timeout=timeout)) if device.model == "hmi" else device  # type: ignore[call-arg]


def _twice(scenario: model.Scenario) -> model.Scenario:
    """The same on a second bus, where things happen at the same ticks if nothing is random."""
    buses = (*scenario.buses, replace(scenario.buses[0], name="second"))
    devices = [replace(device, name=f"{device.name}b", bus="second") for device in scenario.devices]
    plcs = [
        replace(plc, name=f"{plc.name}b", ports=tuple(replace(port, bus="second") for port in plc.ports))
        for plc in scenario.plcs
    ]
    made = replace(scenario, buses=buses, devices=(*scenario.devices, *devices))
    return replace(made, plcs=(*scenario.plcs, *plcs))


def scenario(seed: int) -> model.Scenario:
    """Random polls of random slaves, some with faults of any kind at any time, some with noise."""
    rng = Random(seed)
    made = replace(random_bus(seed), duration=SECONDS * SECOND)
    devices = [
        replace(device, gaps=GapRule(Fraction(rng.choice([7, 9, 20]), 2))) if rng.random() < 0.2 else device
        for device in made.devices
    ]
    if rng.random() < 0.4:  # many responses come when the timeout is nearly over, or just over
        devices = [_hurried(device, rng.randint(8, 60) * MS) for device in devices]
    plcs = [replace(plc, phase=0) if rng.random() < 0.5 else plc for plc in made.plcs]
    made = replace(made, devices=tuple(devices), plcs=tuple(plcs))
    if rng.random() < 0.4:
        made = _twice(made)
    nodes = [device.name for device in devices]
    nodes += [f"{plc.name}.{port.name}" for plc in plcs for port in plc.ports]
    faults = []
    for number in range(rng.choice([0, 0, 1, 2, 4])):
        kind = _kind(rng, rng.choice(nodes), [plc.name for plc in plcs])
        window = model.Window(rng.randrange(SECONDS * SECOND), rng.choice([None, rng.randrange(1, SECOND)]))
        faults.append(model.Fault(f"fault{number}", kind, window))
    noise = []
    if rng.random() < 0.2:
        kinds = [model.BitErrors(1e-4), model.ReplyLoss(0.2)]
        window = model.Window(rng.randrange(SECOND), rng.randrange(1, SECOND))
        noise = [model.Noise("noise", model.Target("bus"), rng.choice(kinds), window)]
    return replace(made, faults=tuple(faults), noise=tuple(noise))


@pytest.mark.parametrize("seed", quick(12, range(400)))
def test_random_buses(seed: int) -> None:
    compare(scenario(seed), traced=False)


@pytest.mark.parametrize("seed", quick(3, range(60)))
def test_a_run_may_be_looked_at_and_go_on(seed: int) -> None:
    made, rng = scenario(seed), Random(seed)
    simulation, record = started(made, traced=False)
    while simulation.now < made.duration:
        simulation.run(min(made.duration, simulation.now + rng.choice([1, 50_000, 5_000_000])))
        if rng.random() < 0.1:
            simulation.totals()
    with one_by_one():
        wanted = left(run(made, traced=False))
    found = left(Done(simulation, record, simulation.totals()))
    assert {key: value for key, value in found.items() if value != wanted[key]} == {}


#: What devices report comes among what else is noted at its tick.
REPORTING = """\
schema: 1
name: reporting
duration: 4 s
buses: [{name: fast, baud: 115200}, {name: slow, baud: 9600}]
devices:
  - {name: drive, model: stepper, bus: slow, station: 1}
  - {name: box, model: stepper, bus: fast, station: 1}
"""
HMI = "  - {{name: {0}hmi, model: hmi, bus: {0}, polls: [{1}]}}\n"
JOG = ", ".join(
    f"{{name: p{value}, station: 1, function: 5, address: 4, values: [{value}], every: 70 ms}}"
    for value in (1, 0)
)


def test_what_devices_report_is_in_order() -> None:
    made = loads(REPORTING + "".join(HMI.format(bus, JOG) for bus in ("fast", "slow")))
    assert len([note for note in run(made, traced=False).record.notes if note.kind == "device"]) > 40
    compare(made, traced=False)


def test_most_transactions_are_done_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    passed: list[bool] = []
    original = TransactionPath.pass_transaction

    def counted(self: TransactionPath, *given: object) -> bool:
        passed.append(original(self, *given))  # type: ignore[arg-type]
        return passed[-1]

    monkeypatch.setattr(TransactionPath, "pass_transaction", counted)
    monkeypatch.setattr(TurnPath, "pass_turns", lambda *_: False)
    run(replace(speed("four ports"), duration=5 * SECOND), traced=False)
    run(loads(REPORTING + HMI.format("fast", JOG)), traced=False)
    assert passed.count(True) > 0.98 * len(passed) > 100
