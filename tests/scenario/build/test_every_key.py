"""Every key of a scenario reaches the frozen scenario, and its canonical form: none is read and forgotten.

The forms of device models are held to the same in ``tests/devices/test_registry.py``.
"""

from __future__ import annotations

import copy
import functools
import re
from collections.abc import Iterable, Iterator
from dataclasses import fields as dataclass_fields
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import pytest
import yaml

import bussim
from bussim.errors import ScenarioError
from bussim.forms.form import Model
from bussim.plc.profiles import Profile
from bussim.scenario.loader import from_data
from bussim.scenario.model import Scenario
from bussim.scenario.schema.disturbances import FaultIn, NoiseIn
from bussim.scenario.schema.document import BusIn, DocumentIn, PlcIn
from bussim.scenario.schema.draft import _is_dict, _model_in
from bussim.scenario.schema.polls import HmiPollIn, PollIn
from bussim.scenario.schema.programs import LatencyIn

#: Every key, with a value other than its default, as the canonical form writes it.
EVERY_KEY = r"""
schema: 1
name: every key
duration: 20 s
seed: 7
allow_unsimulated: true
buses:
  - {name: link, nn: true, contention: zero_wins}
  - {name: feeder, baud: 19200, format: "8E1"}
  - {name: codes, baud: 19200, format: 8N1}
plcs:
  - name: press1
    profile:
      base: pw10
      measured: {master_gap: line.sr}
      master_gap: 1 ms
      turnaround: {mean: 2 ms, jitter: 1 ms}
      scan_overhead: 4 ms
      attempts: retries
      absent_station: probe
      error_count: on_edge
      reply: end
      link_scan_unit: 100 us
      scan_factor: 1.2
      default_timeout: 7
      timeout_range: [5, 100]
      modes: [0, 1, 2]
      firmware: [25020, 16004]
      error_codes: 63xx
      link_at_step_0: true
      latched_pulse_again: true
      latched: [M0-M9, D7000-D7999]
      word_spacing: 40
      transaction_time: 1 ms
      broadcast_turnaround: 200 ms
      rtu_gaps: {end: 4.5, inner: 2.5, fast_character: 400 us}
      ascii_gap: 2 s
      begun_holds: true
      slave_backlog: 2
      slave_errors: false
      com2_station: 4
      free_awaits_first: true
      free_keeps_frame: true
      instruction_times: {basic: 90 ns, timer: 91 ns, comparison: 92 ns, idle: 93 ns, move: 94 ns, arithmetic: 95 ns, block: 96 ns, each: 97 ns, serial: 98 ns, wide: 1.7, others: {MUL: 200 us}}
    scan: {mean: 8 ms, jitter: 1 ms}
    phase: 2 ms
    nn: {bus: link, port: COM4, station: 0, slaves: 2, mode: 1, retries: 5, timeout: 80 ms}
    registers: {D500: 3}
    ports:
      COM2: {bus: feeder, protocol: modbus-rtu-slave, station: 3}
      COM3: {bus: feeder, protocol: modbus-rtu-master, timeout: 150 ms, interval: 10 ms}
      COM5: {bus: codes, protocol: free, timeout: 2 s, start: 2, end: 13, eight_bit: true, baud: 9600, format: 8N2, cpavl: {words: D7000, bits: M2000}}
    polls:
      - {name: get, port: COM3, station: 1, function: 3, address: 22, count: 2, to: D400, every: 200 ms, at: 1 s, times: 5, retries: 1, skip_after_failure: 3}
      - {name: put, port: COM3, station: 1, function: 16, address: 10, count: 2, values: [3, 4], from: D520, retries: 0, skip_after_failure: 1}
      - {name: out, port: COM5, send: D600, send_count: 9, data: 02 41, to: D300, count: 20}
      - {name: say, port: COM5, send_count: 3, send: D610, text: abc}
    sources:
      M1000: {toggle: 1 s}
      D0: {counter: 100 ms}
      D1: {constant: -5}
      D2: {ramp: {from: 10, to: -10, over: 10 s}}
    comments: {X0: limit switch, M1000: 門}
    program: "LD X0\nOUT Y0\nLD X4\nOUT Y1\nEND\n"
    inputs:
      X0: {pulse: {width: 50 ms, every: 2 s, at: 1 s, times: 3}}
      X1: {square: {period: 500 ms, at: 1 s}}
      X2: {random: {"on": 1 s, "off": 2 s, seed: 3}}
      X3: {times: [1 s, 2 s]}
      X4: {square: {period: 700 ms, at: 1 s}}
  - name: press2
    profile: {base: pw10, turnaround: {values: [1 ms, 2 ms], weights: [3.0, 1.0]}}
    scan: {mean: 5 ms, jitter: 0 s}
    nn: {bus: link, port: COM4, station: 1}
  - {name: press3, scan: {mean: 5 ms, jitter: 0 s}, nn: {bus: link, port: COM4, station: 2}}
devices:
  - {name: drive, model: stepper, bus: feeder, station: 1}
  - name: panel
    model: hmi
    bus: feeder
    polls:
      - {name: look, station: 1, function: 3, address: 0, count: 2, every: 300 ms, at: 1 s, times: 4, retries: 2, skip_after_failure: 4}
      - {name: push, station: 1, function: 6, address: 9, count: 1, values: [7], every: 400 ms, at: 1 s, times: 4, retries: 2, skip_after_failure: 1}
noise:
  - {name: hiss, bus: link, station: press2, direction: tx, at: 1 s, for: 2 s, measured: line.sr, ber: 1.0e-6}
  - {bus: link, at: 0 s, burst: {good: 10 s, bad: 20 ms, ber_good: 1.0e-9, ber_bad: 1.0e-2}}
  - {bus: link, at: 0 s, impulse: {every: 20 ms, width: 50 us, ber: 0.25, phase: 3 ms}}
  - {bus: link, at: 0 s, reply_loss: 1.0e-3}
faults:
  - {name: supply, at: 10 s, for: 5 s, power_off: {station: press2}}
  - {at: 1 s, stop: {station: press2}}
  - {at: 1 s, count: 3, drop_reply: {station: press2}}
  - {at: 1 s, slow: {station: press2, extra: 3 ms}}
  - {at: 1 s, jabber: {station: press2}}
  - {at: 1 s, cable_cut: {bus: link, after: press1}}
  - {at: 1 s, wrong_format: {station: press2, format: 7O1, baud: 9600}}
  - {at: 1 s, clock_ppm: {station: press2, ppm: 0.1}}
  - {at: 1 s, late_release: {station: press2, by: 100 us}}
  - {at: 1 s, lose_char: {station: press2, direction: rx, index: 3}}
  - {at: 1 s, insert_char: {station: press2, direction: rx, index: 4, value: 48}}
  - {at: 1 s, pause: {station: press2, index: 5, by: 6 ms}}
  - {at: 1 s, flip_bits: {station: press2, direction: rx, bits: [31, 62], frame: data}}
  - {at: 1 s, board_error: {plc: press2, port: COM5, code: 40}}
  - {power_on: {press2: 4 s}}
observe: [press1.D0]
warnings:
  - {code: bursts, text: errors come in bursts}
latency:
  - {name: through, from: press1.X0, to: press1.Y0, edge: rising, inverted: true}
"""  # fmt: skip

#: The sections of a document and the forms of their entries; polls are below their owners.
SECTIONS: dict[str, type[Model]] = {
    "buses": BusIn,
    "plcs": PlcIn,
    "noise": NoiseIn,
    "faults": FaultIn,
    "latency": LatencyIn,
}
POLLS: dict[str, type[Model]] = {"plcs": PollIn, "devices": HmiPollIn}
#: Keys that stand for another one, with tests of their own: a program's and a table's text is written out.
WRITTEN_OUT = {("ProgramIn", "file"), ("ProgramIn", "text"), ("InputIn", "csv")}
#: Names that are tried in place of one that cannot be left out.
OTHERS = [
    "press3",
    "press1",
    "feeder",
    "free",
    "COM4",
    "fx2n",
    "press1.X4",
    "press1.Y1",
    "modbus-ascii-master",
    "D700",
]

Keys = tuple[str | int, ...]


@functools.cache
def _read() -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load(EVERY_KEY)
    return found


def data() -> dict[str, Any]:
    return copy.deepcopy(_read())


def fields(form: type[Model]) -> dict[str, Any]:
    return {info.alias or name: info for name, info in form.model_fields.items()}


def forms() -> set[type[Model]]:
    """Every form of the schema but those of device models."""
    found: set[type[Model]] = set()
    waiting = [DocumentIn, *SECTIONS.values(), *POLLS.values()]
    while waiting:
        form = waiting.pop()
        if form not in found:
            found.add(form)
            inner = (_model_in(info.annotation) for info in form.model_fields.values())
            waiting += [each for each in inner if each is not None]
    return found


def within(form: type[Model], value: Any, path: Keys) -> Iterator[tuple[type[Model], str, Keys]]:
    """The keys in a mapping of a form and below: their form, name and path."""
    for key, info in fields(form).items():
        if not isinstance(value, dict) or key not in value:
            continue
        yield form, key, (*path, key)
        inner = _model_in(info.annotation)
        if inner is not None:
            named: Iterable[tuple[str | int | None, Any]] = [(None, value[key])]
            if isinstance(value[key], list):
                named = enumerate(value[key])
            elif _is_dict(info.annotation):
                named = value[key].items()
            for name, item in named:
                yield from within(inner, item, (*path, key) if name is None else (*path, key, name))


@functools.cache
def every_key() -> list[tuple[type[Model], str, Keys]]:
    whole = data()
    found = list(within(DocumentIn, whole, ()))
    for section, form in SECTIONS.items():
        for number, entry in enumerate(whole[section]):
            found += within(form, entry, (section, number))
    for section, form in POLLS.items():
        for number, owner in enumerate(whole[section]):
            for index, poll in enumerate(owner.get("polls", ())):
                found += within(form, poll, (section, number, "polls", index))
    return found


def at(whole: Any, path: Keys) -> Any:
    for part in path:
        whole = whole[part]
    return whole


def test_every_key_of_the_schema_is_here() -> None:
    known = {(form.__name__, key) for form in forms() for key in fields(form)}
    given = {(form.__name__, key) for form, key, _ in every_key()}
    assert known - given == WRITTEN_OUT


def distinct() -> dict[tuple[type[Model], str], list[Keys]]:
    """Where each key of each form has a value other than its default."""
    found: dict[tuple[type[Model], str], list[Keys]] = {}
    whole = data()
    for form, key, path in every_key():
        if at(whole, path) != fields(form)[key].default:
            found.setdefault((form, key), []).append(path)
    return found


def test_every_key_has_a_value_other_than_its_default() -> None:
    assert set(distinct()) == {(form, key) for form, key, _ in every_key()}


@pytest.fixture(scope="module")
def frozen() -> Scenario:
    return from_data(data())


def variants(path: Keys) -> Iterator[dict[str, Any]]:
    """The data without a key, then with other values of it."""
    value = at(data(), path)
    match value:
        case bool():
            others: list[Any] = [not value]
        case int() | float():
            others = [value + 1, value - 1, value / 2]
        case str() if found := re.fullmatch(r"([0-9.]+) ([num]?s)", value):
            others = [f"{float(found[1]) * factor:g} {found[2]}" for factor in (2, 0.5)]
        case list():
            others = [value[:-1], value[1:], value[::-1], [1]]
        case _:
            others = [other for other in OTHERS if other != value]
    less = data()
    del at(less, path[:-1])[path[-1]]
    yield less
    for other in [other for other in others if other != value]:
        changed = data()
        at(changed, path[:-1])[path[-1]] = other
        yield changed


@functools.cache
def leaves() -> dict[str, list[Keys]]:
    """The keys whose values are no mappings with keys of their own, by form and name."""
    whole = data()
    return {
        f"{form.__name__}.{key}": paths
        for (form, key), paths in distinct().items()
        if _model_in(fields(form)[key].annotation) is None and not isinstance(at(whole, paths[0]), dict)
    }


#: Keys of which another value breaks what names them, or is no scenario at all.
IDENTITIES = {
    "DocumentIn.schema", "DocumentIn.buses", "DocumentIn.plcs", "BusIn.name", "BusIn.nn", "PlcIn.name",
    "NNIn.station", "NNIn.bus", "PortIn.bus", "PollIn.port", "NoiseIn.bus", "CableCutIn.bus",
}  # fmt: skip


@pytest.mark.parametrize("key", [key for key in leaves() if key not in IDENTITIES])
def test_every_key_reaches_the_frozen_scenario(key: str, frozen: Scenario) -> None:
    for changed in chain.from_iterable(map(variants, leaves()[key])):
        try:
            other = from_data(changed)
        except ScenarioError:
            continue  # it cannot be left out, or not be that
        assert replace(other, warnings=()) != replace(frozen, warnings=()), f"{key} makes no difference"
        return
    pytest.fail("no other value is right: add one to OTHERS")


def test_every_key_is_in_the_canonical_form(frozen: Scenario) -> None:
    whole = data()
    for form, key, path in every_key():
        given, written = at(whole, path), at(frozen.source, path[:-1])
        if not isinstance(written, dict):
            assert form.shorthand == key
            assert written == given
            continue
        assert key in written, path
        if not isinstance(given, dict | list):
            assert written[key] == given, path


@pytest.mark.parametrize("field", [field.name for field in dataclass_fields(Profile)])
def test_every_field_of_a_profile_is_used(field: str) -> None:
    """Somewhere beside the table of profiles, else a scenario would set it in vain."""
    used = re.compile(rf"\.{field}\b")
    files = [file for file in Path(bussim.__file__).parent.rglob("*.py") if file.name != "profiles.py"]
    assert any(used.search(file.read_text(encoding="utf-8")) for file in files)
