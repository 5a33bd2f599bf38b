"""What the devices of a good scenario become, and noise and faults of any node."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import pytest

from bussim.cli import main
from bussim.devices.contract import BusDevice
from bussim.devices.free.model import FreeSettings
from bussim.devices.free.scripted import Message
from bussim.devices.hmi import HmiSettings
from bussim.devices.lx.model import LxSettings
from bussim.devices.map.map import Entry, UserMap
from bussim.devices.map.model import MapSettings
from bussim.devices.map.values import Computed, Fixed, Noise, Sweep
from bussim.devices.stepper.axis import Switch
from bussim.devices.stepper.model import StepperSettings
from bussim.devices.stepper.profile import STEPPER_PROFILE, StepOutput
from bussim.devices.v80.model import V80Settings
from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.pdu import FUNCTIONS
from bussim.engines.modbus.server import Space
from bussim.errors import ScenarioError
from bussim.line.characters import CharFormat, LineTiming
from bussim.plc.ports.spec import PollSpec
from bussim.scenario import fault_kinds, model
from bussim.scenario.loader import load, loads
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND
from tests.scenario.port_samples import DRIVE, changed, more

MS, S = TICKS_PER_MS, TICKS_PER_SECOND
LINE = LineTiming(9600, CharFormat(8, "N", 1))


def device(text: str, *changes: tuple[str, str]) -> BusDevice:
    return loads(changed((DRIVE, text), *changes)).devices[0]


def test_what_a_device_has_if_nothing_is_said() -> None:
    found = device("{name: drive, model: stepper, bus: line}")
    assert found == BusDevice("drive", "stepper", "line", 1, Mode.RTU, LINE, 35 * MS, 0, StepperSettings())
    assert device("{name: drive, model: v80, bus: line}").delay == 0


def test_what_every_slave_may_have() -> None:
    found = device(
        "{name: drive, model: v80, bus: line, station: 247, mode: ascii, delay: 5 ms, jitter: 2 ms, "
        "baud: 19200, format: 7O2}"
    )
    assert (found.station, found.mode, found.delay, found.jitter) == (247, Mode.ASCII, 5 * MS, 2 * MS)
    assert found.timing == LineTiming(19200, CharFormat(7, "O", 2))


def test_lx() -> None:
    found = device(
        "{name: drive, model: lx, bus: line, scan: {mean: 5 ms, jitter: 1 ms}, registers: {D007: -1, X10: 1}}"
    )
    assert found.settings == LxSettings(model.Scan(5 * MS, MS), {"D7": -1, "X10": 1})


def test_v80_by_reference_number() -> None:
    found = device(
        "{name: drive, model: v80, bus: line, coils: {127: 1, 00128: 1}, inputs: {10001: 1, 2: 1}, "
        "input_registers: {30005: 7}, registers: {40108: 0x63, 1: -1, 49999: 5}}"
    )
    assert found.settings == V80Settings(
        {
            (Space.COILS, 126): 1,
            (Space.COILS, 127): 1,
            (Space.INPUTS, 0): 1,
            (Space.INPUTS, 1): 1,
            (Space.INPUT_REGISTERS, 4): 7,
            (Space.HOLDING, 107): 0x63,
            (Space.HOLDING, 0): 0xFFFF,
            (Space.HOLDING, 9998): 5,
        }
    )


def test_stepper() -> None:
    found = device(
        "{name: drive, model: stepper, bus: line, registers: {pitch: 500, distance: -100, step_angle: 90}, "
        "switches: [{input: 1, low: -5}, {input: 2, low: 5, high: 6}], "
        "profile: {save_coil: 30, acceleration_unit: 2.5, homing_zeroes: true, refused_command: 0, "
        "step_output: step, zero_is_endless: false}}"
    )
    assert found.settings == StepperSettings(
        dataclasses.replace(
            STEPPER_PROFILE,
            save_coil=30,
            acceleration_unit=Fraction(5, 2),
            homing_zeroes=True,
            refused_command=0,
            step_output=StepOutput.STEP,
            zero_is_endless=False,
        ),
        (Switch(1, -5), Switch(2, 5, 6)),
        {"pitch": 500, "distance": 0x1_0000_0000 - 100, "step_angle": 90},
    )


MAP = """{name: drive, model: map, bus: line, functions: [3, 6],
     coils: [{address: 5}], inputs: [{address: 5, value: 1, count: 4}],
     registers: [{address: 0, value: -1, writable: true, low: 0, high: 9, name: level},
       {address: 1, words: 2, high_first: true, ramp: {from: 5, to: 0, over: 1 s, repeat: true}},
       {address: 9, noise: {center: 100, spread: 9, every: 1 s, normal: true}}]}"""


def test_map() -> None:
    settings = device(MAP).settings
    assert isinstance(settings, MapSettings)
    assert settings.functions == {3, 6}
    *others, noisy = settings.entries
    assert others == [
        Entry(Space.COILS, 5, Fixed(0)),
        Entry(Space.INPUTS, 5, Fixed(1), 4),
        Entry(Space.HOLDING, 0, Fixed(-1), 1, "level", writable=True, low=0, high=9),
        Entry(Space.HOLDING, 1, Sweep(5, 0, S, repeat=True), words=2, high_first=True),
    ]
    assert isinstance(noisy.value, Noise)
    assert noisy.value == Noise(100, 9, S, noisy.value.key, normal=True)
    UserMap(settings.entries, settings.functions)
    plain = device("{name: drive, model: map, bus: line, registers: [{address: 0}]}").settings
    assert isinstance(plain, MapSettings)
    assert plain.functions == FUNCTIONS


def _noise(found: model.Scenario) -> list[int]:
    settings = found.devices[0].settings
    assert isinstance(settings, MapSettings)
    return [settings.entries[-1].value.value(second * S) for second in range(20)]


def test_the_noise_of_a_map_follows_the_seed_wherever_that_comes_from() -> None:
    found = loads(changed((DRIVE, MAP)))
    other = loads(changed((DRIVE, MAP)), overrides=["seed=5"])
    assert _noise(found) != _noise(other)
    assert dataclasses.replace(found, seed=5) == other
    assert _noise(dataclasses.replace(found, seed=5)) == _noise(other)


def test_the_noise_of_a_map_does_not_depend_on_the_devices_position() -> None:
    moved = loads(changed((DRIVE, "{name: other, model: lx, bus: line, station: 9}\n  - " + MAP)))
    settings = moved.devices[1].settings
    assert isinstance(settings, MapSettings)
    assert settings == device(MAP).settings


def test_hmi() -> None:
    found = device(
        "{name: drive, model: hmi, bus: line, mode: ascii, timeout: 200 ms, interval: 2 ms, turnaround: 3 ms, "
        "polls: [{station: 2, function: 3, address: 7, count: 4, every: 1 s, retries: 2}, "
        "{name: go, station: 2, function: 6, address: 7, values: [-1], times: 1}]}"
    )
    assert (found.station, found.mode) == (None, Mode.ASCII)
    assert found.settings == HmiSettings(
        (
            PollSpec("station 2 03 @7", "", 2, 3, 7, 4, None, (), S, retries=2),
            PollSpec("go", "", 2, 6, 7, 1, None, (65535,), times=1),
        ),
        200 * MS,
        2 * MS,
        3 * MS,
    )


def test_free() -> None:
    found = device(
        "{name: drive, model: free, bus: line, says: ["
        '{text: "A\\r", at: 1 s, every: 2 s, times: 3, jitter: 4 ms}, {bytes: "02 FF", reply_to: "?", '
        'delay: 5 ms}, {text: 12, reply_to: {bytes: "06"}}]}'
    )
    assert found.settings == FreeSettings(
        (
            Message(b"A\r", S, 2 * S, 3, 4 * MS),
            Message(b"\x02\xff", reply_to=b"?", delay=5 * MS),
            Message(b"12", reply_to=b"\x06"),
        )
    )


# -- noise and faults ----------------------------------------------------------------------------------


def test_a_bare_name_of_a_plc_is_its_port_on_that_bus_or_its_link_port() -> None:
    found = loads(
        more(
            "noise:\n"
            "  - {bus: line, station: press1, ber: 0.1}\n"
            "  - {bus: link, station: press1, ber: 0.1}\n"
            "  - {bus: link, station: press1.COM4, ber: 0.1}\n"
            "  - {bus: line, station: drive, reply_loss: 0.1}\n"
            "faults:\n"
            "  - {jabber: press2}\n"
            "  - {jabber: press2.COM3}\n"
            "  - {cable_cut: {bus: line, after: press2}}\n"
            "  - {drop_reply: drive, count: 2}\n"
            "  - {power_off: drive}\n"
            "  - {power_on: {drive: 4 s}}\n"
        )
    )
    assert [entry.target.station for entry in found.noise] == ["press1.COM3", "press1", "press1", "drive"]
    assert [fault.kind for fault in found.faults] == [
        fault_kinds.Jabber("press2"),
        fault_kinds.Jabber("press2.COM3"),
        fault_kinds.CableCut("line", "press2.COM3"),
        fault_kinds.DropReply("drive", 2),
        fault_kinds.PowerOff("drive"),
    ]
    assert found.devices[0].power_on == 4 * S


def test_the_same_node_has_the_same_stream_by_whatever_name() -> None:
    short = loads(more("noise:\n  - {bus: line, station: press1, ber: 0.1}\n"))
    full = loads(more("noise:\n  - {bus: line, station: press1.COM3, ber: 0.1}\n"))
    assert short.noise == full.noise
    assert short.noise[0].name == "ber press1.COM3"


def test_a_wrong_format_fills_in_what_is_right_there() -> None:
    found = loads(more("faults:\n  - {wrong_format: {station: drive, baud: 19200}}\n"))
    assert found.faults[0].kind == fault_kinds.WrongFormat("drive", LineTiming(19200, CharFormat(8, "N", 1)))


def test_frames_and_characters_of_modbus() -> None:
    found = loads(
        more(
            "faults:\n"
            "  - {flip_bits: {station: drive, bits: [5, 2000], frame: response}}\n"
            "  - {insert_char: {station: press1.COM3, direction: rx, value: 255, index: 255}}\n"
        )
    )
    tx, rx = fault_kinds.Direction.TX, fault_kinds.Direction.RX
    assert [fault.kind for fault in found.faults] == [
        fault_kinds.FlipBits("drive", tx, (5, 2000), None, "response"),
        fault_kinds.InsertChar("press1.COM3", rx, None, 255, 255),
    ]


# -- code of the user ----------------------------------------------------------------------------------

CALL = "{name: drive, model: map, bus: line, registers: [{address: 0, call: 'NAME'}]}"


def _calling(folder: Path, name: str, code: str = "") -> Path:
    (folder / "bussim_test_sensors.py").write_text(
        "def level(tick):\n    return tick // 72_000_000\n\nnothing = 5\n" + code, encoding="utf-8"
    )
    file = folder / "x.yaml"
    file.write_text(changed((DRIVE, CALL.replace("NAME", name))), encoding="utf-8")
    return file


@pytest.fixture
def _no_sensors() -> None:
    sys.modules.pop("bussim_test_sensors", None)


@pytest.mark.usefixtures("_no_sensors")
def test_code_is_loaded_with_permission_from_beside_the_scenario(tmp_path: Path) -> None:
    before = list(sys.path)
    found = load(_calling(tmp_path, "bussim_test_sensors:level"), allow_code=True)
    assert sys.path == before
    settings = found.devices[0].settings
    assert isinstance(settings, MapSettings)
    value = settings.entries[0].value
    assert isinstance(value, Computed)
    assert value.value(3 * S) == 3


@pytest.mark.usefixtures("_no_sensors")
def test_without_permission_it_is_a_mistake_and_nothing_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = _calling(tmp_path, "bussim_test_sensors:level")
    with pytest.raises(ScenarioError) as caught:
        load(file)
    assert str(caught.value) == (
        f"{file}:24:73: registers.0.call is bussim_test_sensors:level, which would run Python code: "
        "that takes --allow-code"
    )
    assert "bussim_test_sensors" not in sys.modules
    assert main(["check", str(file)]) == 2
    assert "--allow-code" in capsys.readouterr().err
    assert main(["check", str(file), "--allow-code"]) == 0


@pytest.mark.usefixtures("_no_sensors")
@pytest.mark.parametrize(
    ("name", "code", "message"),
    [
        ("bussim_test_sensors:levl", "", "but bussim_test_sensors has no function levl"),
        ("bussim_test_sensors:nothing", "", "but bussim_test_sensors has something else as function nothing"),
        ("bussim_test_nowhere:level", "", "but there is no module bussim_test_nowhere"),
        (
            "bussim_test_sensors:level",
            "1 / 0",
            "but loading bussim_test_sensors fails: ZeroDivisionError: division by zero",
        ),
    ],
)
def test_code_that_cannot_be_had(tmp_path: Path, name: str, code: str, message: str) -> None:
    file = _calling(tmp_path, name, code)
    with pytest.raises(ScenarioError) as caught:
        load(file, allow_code=True)
    assert str(caught.value) == f"{file}:24:73: registers.0.call is {name}, {message}"


def test_a_scenario_without_devices_does_not_pay_for_their_forms() -> None:
    code = (
        "import sys\nfrom bussim.scenario.loader import load\nload('press_line')\n"
        "print([name for name in sys.modules if name.startswith('bussim.devices.') or "
        "name.startswith('bussim.scenario.') and 'poll' in name])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_a_device_loads_its_own_model_only() -> None:
    code = (
        "import sys\nfrom bussim.scenario.loader import load\nload('barcode_reader')\n"
        "print(sorted({name.split('.')[2] for name in sys.modules if name.startswith('bussim.devices.')}))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "free" in run.stdout
    assert "stepper" not in run.stdout
