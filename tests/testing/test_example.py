"""The example: a small client is tested with the fixtures of the plugin."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import serial

from bussim.line.checksums import crc16_bytes
from bussim.testing import ServedBus
from tests.testing.client import NoResponseError, SmallClient

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")


@pytest.fixture
def client(modbus_slave: ServedBus) -> Iterator[SmallClient]:
    made = SmallClient(modbus_slave.device)
    yield made
    made.close()


def test_it_reads(modbus_slave: ServedBus, client: SmallClient) -> None:
    modbus_slave.registers[5:8] = [1, 2, 65535]
    assert client.read(5, 3) == [1, 2, 65535]
    assert modbus_slave.registers[5:8] == [1, 2, 65535]
    (asked,) = modbus_slave.requests
    assert (asked.station, asked.function) == (1, 3)


@pytest.mark.parametrize(
    ("fault", "seen"),
    [
        (lambda bus: bus.drop_reply(), "silence"),
        (lambda bus: bus.corrupt_check(), "crc"),
        (lambda bus: bus.truncate(), "short"),
        (lambda bus: bus.wrong_station(), "station"),
        (lambda bus: bus.exception(4), "exception 4"),
        (lambda bus: bus.delay(1.5), "silence"),
    ],
)
def test_it_survives_a_fault(
    modbus_slave: ServedBus, client: SmallClient, fault: Callable[[ServedBus], None], seen: str
) -> None:
    modbus_slave.registers[0] = 7
    fault(modbus_slave)
    assert client.read(0) == [7]
    assert client.failures[0] == seen
    assert modbus_slave.pending_faults == 0


@pytest.mark.slow
def test_it_gives_up(modbus_slave: ServedBus, client: SmallClient) -> None:
    modbus_slave.drop_reply(count=3)
    with pytest.raises(NoResponseError, match="silence"):
        client.read(0)
    assert len(modbus_slave.requests) == 3
    assert client.read(0) == [0]


def test_faults_come_in_order_and_can_be_taken_back(modbus_slave: ServedBus, client: SmallClient) -> None:
    modbus_slave.exception(2)
    modbus_slave.corrupt_check()
    assert client.read(0) == [0]
    assert client.failures == ["exception 2", "crc"]
    modbus_slave.drop_reply(count=100)
    modbus_slave.no_faults()
    assert client.read(0) == [0]


def test_a_bus_of_several_stations(modbus_serve: Callable[..., ServedBus]) -> None:
    bus = modbus_serve(stations=(3, 4), paced=True)
    bus.station(4).registers[9] = 99
    for station, value in ((3, 0), (4, 99)):
        client = SmallClient(bus.device, station, timeout=5)
        assert client.read(9) == [value]
        client.close()


def test_what_cannot_be_is_said() -> None:
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"stations": (0,)}, "allowed 1…247"),
        ({"stations": ()}, "needs a station"),
        ({"delay": -1}, "allowed 0…3600"),
        ({"mode": "tcp"}, "tcp"),
        ({"baud": 0}, "at least 1"),
    ]
    for settings, said in wrong:
        with pytest.raises(ValueError, match=said):
            ServedBus(**settings)
    with ServedBus() as bus:
        for call in (lambda: bus.exception(0), lambda: bus.drop_reply(0), lambda: bus.delay(-1)):
            with pytest.raises(ValueError, match=r"allowed|at least"):
                call()
        with pytest.raises(IndexError):
            bus.registers[-1]


def test_the_plugin_costs_a_session_nothing() -> None:
    code = "import sys, bussim.testing.plugin; sys.exit(any(m in sys.modules for m in ('serial', 'numpy')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_pytest_finds_the_fixtures(tmp_path: Path) -> None:
    test = tmp_path / "test_mine.py"
    test.write_text("def test_one(modbus_slave):\n    assert modbus_slave.device\n")
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:bussim",
        "-p",
        "bussim.testing.plugin",
        str(test),
    ]
    ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, env=_here())
    assert "1 passed" in ran.stdout, ran.stdout + ran.stderr


@pytest.mark.slow
def test_the_little_project_of_the_guide_passes_in_a_folder_of_its_own(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "bussim" / "guide" / "python.md").read_text(encoding="utf-8")
    files = re.findall(r"```python\n# (\w+\.py)\n(.*?)```", page, re.DOTALL)
    assert [name for name, _ in files] == ["oven.py", "test_oven.py"]
    for name, text in files:
        (tmp_path / name).write_text(text)
    plugin = ("-p", "no:bussim", "-p", "bussim.testing.plugin", "-p", "no:cacheprovider")
    command = [sys.executable, "-m", "pytest", "-q", *plugin]
    ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, env=_here())
    assert "3 passed" in ran.stdout, ran.stdout + ran.stderr


def test_items_are_lists_of_fixed_length() -> None:
    with ServedBus(stations=(1, 2)) as bus:
        registers, mirror = bus.registers, [0] * len(bus.registers)
        for where, values in (
            (slice(2, 8, 2), [1, 2, 3]),
            (slice(-3, None), [7, 8, 65535]),
            (slice(0, 0), []),
        ):
            registers[where] = values
            mirror[where] = values
            assert registers[where] == mirror[where] == values
        assert list(registers) == mirror
        for where, values in ((slice(0, 3), [1, 2]), (0, -1), (0, 65536), (slice(0, 1), [70000])):
            with pytest.raises(ValueError, match=r"addresses|allowed 0…65535"):
                registers[where] = values  # type: ignore[assignment]
        wrong: tuple[tuple[int | slice, Any], ...] = (
            (slice(0, 2), [1, 1.5]),
            (0, 1.5),
            (0, [1]),
            (slice(0, 1), 1),
            (slice(0, 1), "1"),
        )
        for at, given in wrong:
            with pytest.raises(TypeError):
                registers[at] = given
        with pytest.raises(ValueError, match="allowed 0…1"):
            bus.coils[0] = 2
        assert list(registers) == mirror  # a refused write has written nothing
        assert "2: 1, 4: 2, 6: 3, 9996: 7, 9997: 8, 9998: 65535" in repr(bus)
        assert repr(bus.station(2)) == "all 0"
        registers[0], registers[1:3] = np.uint16(4), np.array([5, 6], dtype=np.uint16)
        assert registers[:3] == [4, 5, 6]


def test_faults_are_one_stations_and_a_refused_write_is_not_carried_out() -> None:
    with ServedBus(stations=(1, 2)) as bus, serial.Serial(bus.device, 115200, timeout=0.3) as port:
        bus.exception(4, station=2)
        bus.drop_reply(station=1)

        def write(station: int, value: int) -> bytes:
            body = bytes((station, 6, 0, 5)) + value.to_bytes(2, "big")
            port.write(body + crc16_bytes(body))
            response = port.read(8)
            time.sleep(0.01)
            return response

        assert write(2, 77)[1:3] == b"\x86\x04"
        assert write(1, 77) == b""
        assert write(1, 78)[:2] == b"\x01\x06"
        assert write(9, 1) == b""
        assert (bus.registers[5], bus.station(2).registers[5]) == (78, 0)
        asked = [(each.station, each.values, each.exception, each.absent) for each in bus.asked]
    assert asked == [(2, (77,), 4, False), (1, (77,), 0, False), (1, (78,), 0, False), (9, (1,), 0, True)]


def _here() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
