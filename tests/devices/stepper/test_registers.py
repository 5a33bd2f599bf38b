"""The stepper's tables: every register and coil, what can be written, what is left out."""

from __future__ import annotations

import pytest

from bussim.devices.stepper.map import Stepper
from bussim.devices.stepper.registers import COILS, REGISTERS, Group
from bussim.engines.modbus.pdu import Request, write_coil, write_coils, write_register, write_registers
from tests.devices.ask import ask, code, coil, put, registers
from tests.devices.stepper.steppers import next_change

# The manual's table 5: (first number, words, read-only).
READ_ONLY = {40013: 1, 40023: 2, 40042: 1, 40043: 1, 40044: 1, 40045: 1, 40046: 1, 40047: 1, 40048: 1}
READ_ONLY |= {40049: 1, 40056: 1, 40057: 1}
DOUBLE = {40005, 40010, 40020, 40023, 40032, 40035, 40074}
GAP = range(40059, 40074)
COIL_NUMBERS = [*range(1, 20), 37]


def test_every_address_of_the_table_and_no_other() -> None:
    device = Stepper()
    for number in range(40001, 40100):
        expected = 0 if number <= 40080 and number not in GAP else 2
        assert code(device, Request(3, number - 40001, 1)) == expected, number


def test_names_lie_where_the_manual_has_them() -> None:
    by_name = {register.name: register for register in REGISTERS}
    numbers = {
        "step_angle": 40001,
        "microsteps": 40002,
        "start_frequency": 40003,
        "acceleration": 40004,
        "pitch": 40005,
        "home_input": 40007,
        "stop_mode": 40008,
        "speed": 40009,
        "distance": 40010,
        "direction": 40012,
        "arrived": 40013,
        "forward_limit_input": 40015,
        "reverse_limit_input": 40016,
        "station": 40017,
        "project_start_input": 40018,
        "project_stop_input": 40019,
        "work_count": 40020,
        "position": 40023,
        "project": 40025,
        "total_steps": 40026,
        "step_start_input": 40027,
        "step_start_frequency": 40028,
        "step_acceleration": 40029,
        "step_direction": 40030,
        "step_speed": 40031,
        "step_distance": 40032,
        "step_output": 40034,
        "step_delay": 40035,
        "loop_first": 40037,
        "loop_last": 40038,
        "loop_count": 40039,
        "step_number": 40040,
        "running_step": 40042,
        "input_1": 40043,
        "input_5": 40047,
        "output_1": 40048,
        "running": 40049,
        "project_loops": 40050,
        "step_stop_input": 40051,
        "output_2": 40056,
        "output_3": 40057,
        "round_trips": 40058,
        "baud": 40074,
        "absolute": 40076,
        "signal_mode": 40077,
        "forward_input": 40078,
        "reverse_input": 40079,
        "disabled": 40080,
    }
    assert {name: by_name[name].number for name in numbers} == numbers
    assert {r.number for r in REGISTERS if r.words == 2} == DOUBLE
    assert {r.number: r.words for r in REGISTERS if not r.writable} == READ_ONLY


def test_protocol_address_is_number_less_one_in_hexadecimal() -> None:
    """The table's own last column, at a few rows."""
    by_number = {register.number: register.address for register in REGISTERS}
    rows = {40001: 0x0000, 40017: 0x10, 40023: 0x16, 40040: 0x27, 40058: 0x39, 40074: 0x49, 40080: 0x4F}
    assert {number: by_number[number] for number in rows} == rows


def test_delivered_with() -> None:
    device = Stepper()
    assert registers(device, 0, 2) == (180, 8)
    assert registers(device, 40017 - 40001) == (1,)
    assert registers(device, 40074 - 40001, 2) == (9600, 0)
    assert (device.station, device.baud) == (1, 9600)


@pytest.mark.parametrize("number", [n + k for n, words in READ_ONLY.items() for k in range(words)])
def test_read_only_registers(number: int) -> None:
    device = Stepper()
    assert put(device, number - 40001, 1) == 2
    # A write across one changes nothing before it either.
    assert put(device, number - 40002, 1, 1) == 2
    assert registers(device, number - 40002) == registers(Stepper(), number - 40002)


@pytest.mark.parametrize("register", [r for r in REGISTERS if r.writable], ids=lambda r: r.name)
def test_every_writable_register_keeps_what_it_may(register: object) -> None:
    device = Stepper()
    value = min(register.high, 0xABCD_1234 if register.words == 2 else 0x5678)
    words = [value >> 16 * word & 0xFFFF for word in range(register.words)]
    assert put(device, register.address, *words) == 0
    assert registers(device, register.address, register.words) == tuple(words)
    assert device.value(register.name, 0) == value
    if register.high < 0xFFFF:
        assert put(device, register.address, register.high + 1) == 3
        assert device.value(register.name, 0) == value
    if register.low > 0:
        assert put(device, register.address, register.low - 1) == 3


def test_halves_of_a_double_register_can_be_written_alone() -> None:
    device = Stepper()
    assert put(device, 0x0A, 2) == 0  # 40011, the high word
    assert put(device, 0x09, 5) == 0
    assert device.value("distance", 0) == 0x0002_0005
    assert registers(device, 0x09, 2) == (5, 2)


def test_manuals_example_distance_200() -> None:
    device = Stepper()
    assert put(device, 9, 200, 0) == 0
    assert device.value("distance", 0) == 200  # 2.00 units


@pytest.mark.parametrize(
    "request_",
    [
        Request(1, 0, 1),
        Request(2, 0, 1),
        Request(4, 0, 1),
        write_coils(0, (1,)),
        Request(1, 500, 1),  # the function is checked before the address
    ],
)
def test_functions_that_it_lacks(request_: Request) -> None:
    assert code(Stepper(), request_) == 1


def test_coils_of_the_table_and_no_other() -> None:
    assert list(COILS) == COIL_NUMBERS
    for number in range(1, 60):
        device = Stepper()
        expected = 0 if number in COIL_NUMBERS else 2
        assert coil(device, number - 1, on=False) == expected, number


def test_names_of_coils() -> None:
    assert COILS[1] == "save"  # assumed
    assert COILS[8] == "run_once"  # printed as 80000
    assert COILS[17] == "output_3_off"  # printed as "on" once more
    assert COILS[37] == "reset_basic"


@pytest.mark.parametrize("word", [0x0001, 0xFF01, 0xFFFF])
def test_other_values_of_a_coil_are_refused(word: int) -> None:
    device = Stepper()
    assert code(device, Request(5, 11, 1, (word,))) == 3
    assert device.value("output_1", 0) == 0


def test_reading_across_the_gap() -> None:
    device = Stepper()
    assert code(device, Request(3, 0, 58)) == 0
    assert code(device, Request(3, 0, 59)) == 2
    assert code(device, Request(3, 40073 - 40001, 2)) == 2
    assert code(device, Request(3, 40074 - 40001, 7)) == 0
    assert code(device, Request(3, 40074 - 40001, 8)) == 2


def test_everything_at_once_is_refused_whole() -> None:
    device = Stepper()
    assert code(device, write_registers(0, tuple(range(1, 14)))) == 2  # 40013 is read-only
    assert registers(device, 0, 2) == (180, 8)


# -- station, rate, saving -------------------------------------------------------------------------


def cycle(device: Stepper, now: int = 0) -> None:
    device.power_off(now)
    device.power_on(now)


def test_a_new_station_needs_saving_and_a_power_cycle() -> None:
    device = Stepper()
    assert put(device, 0x10, 5) == 0
    assert device.station == 1
    cycle(device)  # not saved: lost
    assert device.station == 1
    assert registers(device, 0x10) == (1,)
    put(device, 0x10, 5)
    assert coil(device, 0) == 0
    assert device.station == 1  # saved, but power was not off
    cycle(device)
    assert device.station == 5


@pytest.mark.parametrize("baud", [4800, 9600, 19200, 38400, 115200])
def test_a_new_rate_needs_saving_and_a_power_cycle(baud: int) -> None:
    device = Stepper()
    put(device, 0x49, baud & 0xFFFF, baud >> 16)
    coil(device, 0)
    assert device.baud == 9600
    cycle(device)
    assert device.baud == baud


def test_a_rate_that_does_not_exist_leaves_the_old_one() -> None:
    device = Stepper(baud=19200)
    put(device, 0x49, 57600, 0)
    coil(device, 0)
    cycle(device)
    assert device.baud == 19200


def test_saving_keeps_basic_and_project_but_not_the_rest() -> None:
    device = Stepper()
    put(device, 0x08, 123)  # speed
    put(device, 0x19, 7)  # steps of the project
    put(device, 0x27, 3)  # step number
    put(device, 0x1E, 99)  # speed of step 3
    put(device, 0x13, 42, 0)  # work count
    put(device, 0x33, 5)  # spare
    coil(device, 0)
    put(device, 0x08, 321)
    cycle(device)
    assert (device.value("speed", 0), device.value("total_steps", 0)) == (123, 7)
    assert (device.value("step_number", 0), device.value("work_count", 0)) == (1, 0)
    assert registers(device, 0x33) == (0,)
    put(device, 0x27, 3)
    assert device.value("step_speed", 0) == 99


def test_each_step_has_registers_of_its_own() -> None:
    device = Stepper()
    for step in (1, 2, 33):
        put(device, 0x27, step)
        put(device, 0x1F, step, step)  # distance
    for step in (1, 2, 33):
        put(device, 0x27, step)
        assert registers(device, 0x1F, 2) == (step, step)
    assert put(device, 0x27, 34) == 3
    assert put(device, 0x27, 0) == 3


def test_step_number_goes_up_and_down_by_coil() -> None:
    device = Stepper()
    coil(device, 17)
    assert device.value("step_number", 0) == 1
    coil(device, 18)
    coil(device, 18)
    assert device.value("step_number", 0) == 3
    coil(device, 17)
    assert device.value("step_number", 0) == 2
    put(device, 0x27, 33)
    coil(device, 18)
    assert device.value("step_number", 0) == 33


def test_project_is_cleared_and_read_back() -> None:
    device = Stepper()
    put(device, 0x19, 7)
    put(device, 0x1E, 99)
    coil(device, 0)
    assert coil(device, 2) == 0  # clear
    assert (device.value("total_steps", 0), device.value("step_speed", 0)) == (1, 0)
    assert coil(device, 1) == 0  # read
    assert (device.value("total_steps", 0), device.value("step_speed", 0)) == (7, 99)


def test_basic_parameters_are_reset() -> None:
    device = Stepper(station=9, baud=19200)
    put(device, 0x08, 999)
    put(device, 0x19, 7)
    assert coil(device, 36) == 0
    assert (device.value("speed", 0), device.value("station", 0)) == (60, 1)
    assert device.value("total_steps", 0) == 7  # the project stays
    assert (device.station, device.baud) == (9, 19200)  # until saved and switched off and on
    coil(device, 0)
    cycle(device)
    assert (device.station, device.baud) == (1, 9600)


def test_groups_hold_what_their_coils_say() -> None:
    groups = {r.name: r.group for r in REGISTERS}
    assert groups["baud"] is groups["station"] is groups["pitch"] is Group.BASIC
    assert groups["loop_count"] is Group.PROJECT
    assert groups["step_stop_input"] is Group.STEP


def test_writes_through_function_06_of_everything_plain() -> None:
    device = Stepper()
    assert code(device, write_register(1, 4)) == 0  # the manual's example: microsteps = 4
    assert ask(device, Request(3, 0, 2)) == (180, 4)


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"station": 0}, r"station \(=0\) must be in \[1...247\]"),
        ({"baud": 57600}, r"baud \(=57600\) must be one of 4800, 9600, 19200, 38400, 115200"),
    ],
)
def test_impossible_settings(kwargs: dict[str, int], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Stepper(**kwargs)


def test_a_coil_that_is_off_does_nothing() -> None:
    device = Stepper()
    for number in COILS:
        assert code(device, write_coil(number - 1, on=False)) == 0
    assert next_change(device) is None
    assert device.poll() is None
