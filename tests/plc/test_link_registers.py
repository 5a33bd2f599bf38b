from __future__ import annotations

from dataclasses import replace

import pytest

from bussim.engines.nn.frames import LinkSettings
from bussim.engines.nn.master import Master
from bussim.engines.nn.slave import Slave
from bussim.plc.link_registers import (
    LinkRegisters,
    bad_parameters,
    master_config,
    setting_values,
    worst_turnaround,
)
from bussim.plc.memory import BlockRange, Device, Memory
from bussim.plc.profiles import PROFILES, AbsentStation, Attempts, ErrorCount, Profile, Reply

MS = 72_000
PW10, FX2N, FX1S = PROFILES["pw10"], PROFILES["fx2n"], PROFILES["fx1s"]
GOOD = {"D8176": 0, "D8177": 7, "D8178": 2, "D8179": 3, "D8180": 10}


def board(profile: Profile = PW10, **registers: int) -> tuple[LinkRegisters, Memory]:
    memory = Memory()
    for address, value in setting_values(profile, registers).items():
        memory.set_word("D", address, value)
    return LinkRegisters(profile, memory), memory


@pytest.mark.parametrize(
    ("profile", "device", "allowed", "refused"),
    [
        (PW10, "D8177", (1, 7), (0, 8, 65535)),
        (PW10, "D8178", (0, 4), (5, 65535)),
        (FX2N, "D8178", (0, 2), (3, 4)),
        (FX1S, "D8178", (0, 0), (1, 2)),
        (PW10, "D8179", (0, 10), (11, 65535)),
        (PW10, "D8180", (5, 225), (0, 4, 226, 255)),
        (FX2N, "D8180", (5, 255), (4, 256)),
        (PW10, "D8176", (0, 7), (8, 65535)),
    ],
)
def test_what_a_plc_takes_and_refuses(
    profile: Profile, device: str, allowed: tuple[int, ...], refused: tuple[int, ...]
) -> None:
    good = GOOD if profile is not FX1S else {**GOOD, "D8178": 0}
    for value in allowed:
        assert bad_parameters(profile, setting_values(profile, {**good, device: value})) == []
    for value in refused:
        (reason,) = bad_parameters(profile, setting_values(profile, {**good, device: value}))
        assert reason.startswith(f"{device} is {value}, allowed ")


def test_a_slave_needs_only_its_number() -> None:
    registers = {"D8176": 3, "D8177": 0, "D8178": 99, "D8179": 99, "D8180": 0}
    assert bad_parameters(PW10, setting_values(PW10, registers)) == []


def test_every_mistake_is_named() -> None:
    registers = {"D8176": 0, "D8177": 0, "D8178": 9, "D8179": 11, "D8180": 4}
    assert len(bad_parameters(PW10, setting_values(PW10, registers))) == 4


def test_defaults_are_the_manuals() -> None:
    assert setting_values(PW10, {}) == {8176: 0, 8177: 7, 8178: 0, 8179: 3, 8180: 10}
    assert setting_values(FX2N, {}) == {8176: 0, 8177: 7, 8178: 0, 8179: 3, 8180: 5}


@pytest.mark.parametrize(("m8179", "code"), [(0, 7348), (1, 7448)])
def test_a_bad_parameter_is_7348_or_7448(m8179: int, code: int) -> None:
    tested, memory = board(D8177=0)
    memory.set(Device("M", 8179), m8179)
    assert tested.take_over(0, traced=False) is None
    assert tested.engine is None
    found = tested.registers()
    assert (found["M8063"], found["D8063"], found["M8191"]) == (1, code, 0)


def test_a_master_mirrors_its_settings_and_a_slave_those_of_its_master() -> None:
    tested, memory = board(D8177=2, D8178=1)
    assert isinstance(tested.take_over(0, traced=False), Master)
    assert [memory.word("D", n) for n in (8173, 8174, 8175)] == [0, 2, 1]
    assert tested.block == BlockRange(1000, 32, 0, 4)
    tested, memory = board(D8176=3)
    assert isinstance(tested.take_over(0, traced=False), Slave)
    assert [memory.word("D", n) for n in (8173, 8174, 8175)] == [3, 0, 0]
    assert (tested.block, tested.mode) == (None, None)
    tested.parameters(LinkSettings(5, 2, 3, 10))
    assert [memory.word("D", n) for n in (8173, 8174, 8175)] == [3, 5, 2]
    assert (tested.block, tested.mode) == (BlockRange(1192, 64, 96, 8), 2)
    tested.release()
    assert [memory.word("D", n) for n in (8173, 8174, 8175)] == [3, 0, 0]


@pytest.mark.parametrize(
    ("ticks", "shown"),
    [
        (None, 0),
        (MS // 2 - 1, 0),
        (MS // 2, 1),
        (50 * MS + MS // 2 - 1, 50),
        (50 * MS + MS // 2, 51),
        (40_000 * MS, 32_767),
    ],
)
def test_a_link_scan_time_is_rounded_half_up(ticks: int | None, shown: int) -> None:
    assert board()[0].in_units(ticks) == shown


def test_the_unit_of_the_link_scan_time_is_the_profiles() -> None:
    tenths = replace(PW10, link_scan_unit=10 * MS)
    assert board(tenths)[0].in_units(344 * MS + 36_000) == 34
    assert board(tenths)[0].in_units(345 * MS) == 35


def test_take_over_clears_the_status_and_publish_writes_it() -> None:
    tested, memory = board(D8177=2)
    engine = tested.take_over(0, traced=False)
    assert isinstance(engine, Master)
    status = engine.status
    status.current, status.longest, status.running = 50 * MS, 90 * MS, True
    for station in range(8):
        status.counts[station], status.codes[station] = 10 + station, 0x20 + station
        status.flags[station] = station % 2 == 1
    tested.publish()
    assert [memory.word("D", n) for n in range(8201, 8219)] == [50, 90, *range(10, 18), *range(0x20, 0x28)]
    assert [memory.get(Device("M", n)) for n in range(8183, 8192)] == [0, 1] * 4 + [1]
    tested.take_over(0, traced=False)
    assert [memory.word("D", n) for n in range(8201, 8219)] == [0] * 18
    assert [memory.get(Device("M", n)) for n in range(8183, 8192)] == [0] * 9


def test_the_fx1s_keeps_its_devices_elsewhere_and_reports_them_under_the_common_names() -> None:
    tested, memory = board(FX1S, D8177=2)
    engine = tested.take_over(0, traced=False)
    assert isinstance(engine, Master)
    engine.status.current = 18 * MS
    engine.status.counts[1], engine.status.codes[2] = 7, 4
    engine.status.flags[0] = engine.status.flags[7] = engine.status.running = True
    tested.publish()
    assert (memory.word("D", 201), memory.word("D", 204), memory.word("D", 213)) == (18, 7, 4)
    # M503 runs, M504 is the master's error, M505–M511 are the slaves'.
    assert [memory.get(Device("M", n)) for n in range(503, 512)] == [1, 1, 0, 0, 0, 0, 0, 0, 1]
    assert memory.word("D", 8201) == memory.get(Device("M", 8191)) == 0
    found = tested.registers()
    assert (found["D8201"], found["D8204"], found["D8213"]) == (18, 7, 4)
    assert (found["M8191"], found["M8183"], found["M8184"], found["M8190"]) == (1, 1, 0, 1)


def test_registers_are_every_device_of_the_link() -> None:
    names = [f"D{n}" for n in (*range(8173, 8181), *range(8201, 8219), 8063)]
    names += [f"M{n}" for n in (8063, 8179, *range(8183, 8192))]
    for profile in PROFILES.values():
        assert sorted(board(profile)[0].registers()) == sorted(names)


@pytest.mark.parametrize(
    ("reading", "retries", "attempts"),
    [
        (Attempts.RETRIES_PLUS_1, 0, 1),
        (Attempts.RETRIES_PLUS_1, 3, 4),
        (Attempts.RETRIES, 0, 1),
        (Attempts.RETRIES, 1, 1),
        (Attempts.RETRIES, 3, 3),
    ],
)
def test_a_masters_configuration_is_its_registers_and_its_profile(
    reading: Attempts, retries: int, attempts: int
) -> None:
    profile = replace(
        PW10, attempts=reading, absent_station=AbsentStation.PROBE, error_count=ErrorCount.ON_EDGE
    )
    config = master_config(profile, setting_values(profile, {**GOOD, "D8179": retries}))
    assert config.settings == LinkSettings(7, 2, retries, 10)
    assert config.attempts == attempts
    assert config.timeout == 100 * MS
    assert (config.gap, config.overhead) == (30_060, 253_440)
    assert config.probe
    assert config.count_on_edge


def test_the_worst_reply_waits_for_an_end_where_replies_do() -> None:
    assert worst_turnaround(PW10, 9 * MS) == 30_060 + 7_200
    assert worst_turnaround(replace(PW10, reply=Reply.END), 9 * MS) == 30_060 + 7_200 + 9 * MS
