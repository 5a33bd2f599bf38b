"""What a good scenario becomes."""

from __future__ import annotations

import dataclasses
from fractions import Fraction

import pytest

from bussim.engines.modbus.gaps import GapRule
from bussim.errors import ScenarioError
from bussim.line.characters import NN_LINE, CharFormat, LineTiming
from bussim.line.protocols import BusProtocol
from bussim.plc.profiles import PROFILES, AbsentStation, Attempts, ErrorCount, Reply, Turnaround
from bussim.plc.program.instruction_times import InstructionTimes
from bussim.plc.sources import Constant, Counter, Ramp, Toggle
from bussim.scenario import fault_kinds, model
from bussim.scenario.loader import from_data, loads
from bussim.scenario.schema.profiles import ProfileIn
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND
from tests.scenario.samples import BASE, added, changed

MS, S = TICKS_PER_MS, TICKS_PER_SECOND

FULL = """\
schema: 1
name: three presses and a feeder
duration: 60 s
seed: 7
buses:
  - {name: link, nn: true}
  - {name: feeder, baud: 19200, format: 8E1}
plcs:
  - name: press1
    profile: pw10
    scan: {mean: 8 ms, jitter: 1 ms}
    nn: {bus: link, port: COM4, station: 0, slaves: 2, mode: 2, retries: 5, timeout: 50 ms}
    sources:
      M1000: {toggle: 1 s}
      D0: {counter: 100 ms}
      D1: {constant: -5}
      D2: {ramp: {from: 10, to: -10, over: 10 s}}
  - {name: press2, profile: pw10, scan: 5 ms, phase: 2 ms, nn: {bus: link, port: COM4, station: 1}}
  - {name: press3, profile: fx3u, scan: 12 ms, registers: {D8176: 2, M8179: 1}, ports: {COM4: {bus: link}}}
noise:
  - {bus: link, ber: 1.0e-6}
  - {bus: link, at: 1 s, for: 2 s, burst: {good: 10 s, bad: 20 ms, ber_good: 0, ber_bad: 1.0e-2}}
  - {bus: link, impulse: {every: 20 ms, width: 50 us, ber: 0.5, phase: 3 ms}}
  - {name: lost, bus: link, station: press3, reply_loss: 1.0e-3}
  - {bus: link, station: press1, direction: tx, ber: 1e-4}
faults:
  - {at: 10 s, for: 5 s, power_off: press2}
  - {at: 30 s, count: 3, drop_reply: press3}
  - {power_on: {press2: 4 s}}
  - {at: 31 s, stop: {station: press2}}
  - {slow: {station: press2, extra: 3 ms}}
  - {jabber: press2}
  - {cable_cut: {bus: link, after: press2}}
  - {wrong_format: {station: press2, format: 7O1}}
  - {wrong_format: {station: press3, baud: 9600}}
  - {clock_ppm: {station: press2, ppm: 0.1}}
  - {late_release: {station: press2, by: 100 us}}
  - {name: gap, lose_char: press2}
  - {count: 2, insert_char: {station: press2, direction: rx, index: 4, value: 0x30}}
  - {flip_bits: {station: press2, bits: [62, 31], frame: data}}
  - {board_error: {plc: press2, port: COM5, code: 40}}
  - {count: 3, pause: {station: press2, index: 4, by: 1 ms}}
"""


def test_the_whole_form() -> None:
    found = loads(FULL)
    assert (found.name, found.duration, found.seed) == ("three presses and a feeder", 60 * S, 7)
    assert found.buses == (
        model.Bus("link", BusProtocol.NN, timing=NN_LINE),
        model.Bus("feeder", BusProtocol.SERIAL, timing=LineTiming(19200, CharFormat(8, "E", 1))),
    )
    press1, press2, press3 = found.plcs
    assert press1 == model.Plc(
        name="press1",
        profile=PROFILES["pw10"],
        scan=model.Scan(8 * MS, MS),
        link=model.LinkAttachment("link", "COM4"),
        registers={"D8176": 0, "D8177": 2, "D8178": 2, "D8179": 5, "D8180": 5, "M8179": 1},
        sources={
            "M1000": Toggle(S),
            "D0": Counter(100 * MS),
            "D1": Constant(-5),
            "D2": Ramp(10, -10, 10 * S),
        },
    )
    assert press2.registers == {"D8176": 1, "M8179": 1}
    assert (press2.phase, press2.power_on, press2.scan) == (2 * MS, 4 * S, model.Scan(5 * MS, 0))
    assert press3.registers == {"D8176": 2, "M8179": 1}
    assert press3.link == model.LinkAttachment("link", "COM4")
    assert press3.profile == PROFILES["fx3u"]


def test_noise() -> None:
    link = model.Target("link")
    assert loads(FULL).noise == (
        model.Noise("ber link", link, model.BitErrors(1e-6)),
        model.Noise("burst link", link, model.Burst(10 * S, 20 * MS, 0.0, 0.01), model.Window(S, 2 * S)),
        model.Noise("impulse link", link, model.Impulse(20 * MS, 3600, 0.5, 3 * MS)),
        model.Noise("lost", model.Target("link", "press3", fault_kinds.Direction.TX), model.ReplyLoss(1e-3)),
        model.Noise(
            "ber press1", model.Target("link", "press1", fault_kinds.Direction.TX), model.BitErrors(1e-4)
        ),
    )


def test_faults() -> None:
    rx, tx = fault_kinds.Direction.RX, fault_kinds.Direction.TX
    assert loads(FULL).faults == (
        model.Fault("power_off press2", fault_kinds.PowerOff("press2"), model.Window(10 * S, 5 * S)),
        model.Fault("drop_reply press3", fault_kinds.DropReply("press3", 3), model.Window(30 * S)),
        model.Fault("stop press2", fault_kinds.Stop("press2"), model.Window(31 * S)),
        model.Fault("slow press2", fault_kinds.Slow("press2", 3 * MS)),
        model.Fault("jabber press2", fault_kinds.Jabber("press2")),
        model.Fault("cable_cut after press2", fault_kinds.CableCut("link", "press2")),
        model.Fault(
            "wrong_format press2", fault_kinds.WrongFormat("press2", LineTiming(38400, CharFormat(7, "O", 1)))
        ),
        model.Fault(
            "wrong_format press3", fault_kinds.WrongFormat("press3", LineTiming(9600, CharFormat(7, "E", 1)))
        ),
        model.Fault("clock_ppm press2", fault_kinds.ClockPpm("press2", Fraction(1, 10))),
        model.Fault("late_release press2", fault_kinds.LateRelease("press2", 7200)),
        model.Fault("gap", fault_kinds.LoseChar("press2", tx, None)),
        model.Fault("insert_char press2", fault_kinds.InsertChar("press2", rx, 2, 4, 0x30)),
        model.Fault("flip_bits press2", fault_kinds.FlipBits("press2", tx, (31, 62), None, "data")),
        model.Fault("board_error press2", fault_kinds.BoardError("press2", "COM5", 40)),
        model.Fault("pause press2", fault_kinds.Pause("press2", MS, 3, 4)),
    )


def test_names_that_the_loader_gives_do_not_depend_on_other_entries() -> None:
    noise = "noise:\n  - {bus: link, ber: 1e-5}\n  - {bus: link, station: press2, ber: 1e-4}\n"
    names = [entry.name for entry in loads(added(noise)).noise]
    assert names == ["ber link", "ber press2"]
    twice = loads(added(noise + "  - {bus: link, ber: 1e-6}\n  - {name: x, bus: link, ber: 0}\n"))
    assert [entry.name for entry in twice.noise] == [*names, "ber link #2", "x"]


def test_what_a_master_leaves_open_is_filled_in() -> None:
    text = BASE.replace(", slaves: 2, timeout: 50 ms", "")
    found = loads(text).plcs[0].registers
    assert found == {"D8176": 0, "D8177": 7, "D8178": 0, "D8179": 3, "D8180": 10, "M8179": 1}
    found = loads(text.replace("scan: 8 ms", "scan: 8 ms\n    profile: fx2n")).plcs[0].registers
    assert found["D8180"] == 5


def test_registers_fill_what_nn_leaves_open() -> None:
    text = BASE.replace("slaves: 2, timeout: 50 ms", "slaves: 2").replace(
        "scan: 8 ms", "scan: 8 ms\n    registers: {D8180: 7, D8177: 2, D500: -1, D0100: 3, M8179: 1}"
    )
    found = loads(text).plcs[0].registers
    assert (found["D8180"], found["D8177"], found["D500"], found["D100"]) == (7, 2, -1, 3)


def test_the_port_is_com3_unless_something_selects_com4() -> None:
    text = BASE.replace("{bus: link, port: COM4, station: 1}", "{bus: link, station: 1}")
    assert loads(text).plcs[1].link == model.LinkAttachment("link", "COM3")
    assert loads(text).plcs[1].registers["M8179"] == 0
    text = text.replace("name: press2,", "name: press2, registers: {M8179: 1},")
    assert loads(text).plcs[1].link == model.LinkAttachment("link", "COM4")


@pytest.mark.parametrize(
    "registers", ["M8179: 0", "D8176: 3", "D8177: 7", "D8178: 0", "D8179: 3", "D8180: 10"]
)
def test_setting_any_of_the_link_registers_takes_part(registers: str) -> None:
    text = added(f"  - {{name: press4, registers: {{{registers}}}, ports: {{COM3: {{bus: link}}}}}}\n")
    assert loads(text).plcs[3].link == model.LinkAttachment("link", "COM3")


def test_a_plc_without_any_of_them_takes_no_part() -> None:
    assert loads(added("  - {name: press4, registers: {D100: 1}}\n")).plcs[3].link is None


def test_a_profile_with_fields_changed() -> None:
    profile = (
        "{base: fx2n, master_gap: 1 ms, turnaround: {mean: 1.25 ms, jitter: 0.75 ms}, scan_overhead: 2 ms, "
        "attempts: retries, absent_station: probe, error_count: on_edge, reply: end, link_scan_unit: 100 us, "
        "scan_factor: 1.05, default_timeout: 20, timeout_range: [10, 200], modes: [0, 2], word_spacing: 16}"
    )
    found = loads(changed("scan: 8 ms", f"scan: 8 ms\n    profile: {profile}").replace("50 ms", "100 ms"))
    assert found.plcs[0].profile == dataclasses.replace(
        PROFILES["fx2n"],
        master_gap=MS,
        turnaround=Turnaround(90_000, 54_000),
        scan_overhead=2 * MS,
        attempts=Attempts.RETRIES,
        absent_station=AbsentStation.PROBE,
        error_count=ErrorCount.ON_EDGE,
        reply=Reply.END,
        link_scan_unit=7200,
        scan_factor=Fraction(21, 20),
        default_timeout=20,
        timeout_range=(10, 200),
        modes=(0, 2),
        word_spacing=16,
    )


def test_a_profile_with_the_fields_of_ports_changed() -> None:
    profile = (
        "{base: pw10, transaction_time: 350 us, broadcast_turnaround: 150 ms, "
        "rtu_gaps: {end: 4.5, inner: 1.1, fast_character: none}, ascii_gap: 20 ms, begun_holds: true, "
        "slave_backlog: 2, com2_station: 9, free_awaits_first: true, free_keeps_frame: true, "
        "instruction_times: {basic: 100 ns, timer: 1 us, comparison: 2 us, idle: 50 ns, move: 3.25 us, "
        "arithmetic: 10 us, block: 11 us, each: 12 us, serial: 1 ms, wide: 2, others: {MUL: 7 us, MUL off: 60 ns}}}"
    )
    found = loads(changed("scan: 8 ms", f"scan: 8 ms\n    profile: {profile}")).plcs[0].profile
    assert found == dataclasses.replace(
        PROFILES["pw10"],
        transaction_time=25_200,
        broadcast_turnaround=150 * MS,
        rtu_gaps=GapRule(Fraction(9, 2), Fraction(11, 10), None),
        ascii_gap=20 * MS,
        begun_holds=True,
        slave_backlog=2,
        com2_station=9,
        free_awaits_first=True,
        free_keeps_frame=True,
        instruction_times=InstructionTimes(
            100,
            1000,
            2000,
            50,
            3250,
            10_000,
            11_000,
            12_000,
            1_000_000,
            2.0,
            (("MUL", 7000), ("MUL off", 60)),
        ),
    )
    given = dict.fromkeys(field.name for field in dataclasses.fields(found))
    unreachable = given.keys() - ProfileIn.model_fields.keys()
    # What a family is, not how it behaves.
    assert unreachable == {"name", "documented_modes", "board_ports", "rs_port"}


def test_silences_left_out_stay_as_they_are() -> None:
    text = changed("scan: 8 ms", "scan: 8 ms\n    profile: {base: pw10, rtu_gaps: {fast_character: 400 us}}")
    assert loads(text).plcs[0].profile.rtu_gaps == GapRule(fast_character=28_800)
    text = changed(
        "scan: 8 ms", "scan: 8 ms\n    profile: {base: pw10, instruction_times: {others: {MOV: 1 us}}}"
    )
    assert loads(text).plcs[0].profile.instruction_times == InstructionTimes(others=(("MOV", 1000),))


def test_a_measured_turnaround() -> None:
    text = changed(
        "scan: 8 ms",
        "scan: 8 ms\n    profile: {base: pw10, turnaround: {values: [1 ms, 4 ms], weights: [2, 1]}}",
    )
    assert loads(text).plcs[0].profile.turnaround == Turnaround(2 * MS, 0, (MS, 4 * MS), (2.0, 1.0))


@pytest.mark.parametrize("written", ["7E1", "'7E1'", "7-E-1", "7e1"])
def test_a_format_that_looks_like_a_number(written: str) -> None:
    text = changed("{name: link, nn: true}", f"{{name: link, nn: true, baud: 38400, format: {written}}}")
    assert loads(text).buses[0].timing == NN_LINE


def test_sections_that_are_commented_out_are_empty() -> None:
    found = loads(added("noise:\n#  - {bus: link, ber: 1}\nfaults:\n"))
    assert (found.noise, found.faults) == ((), ())


def test_plain_data_load_as_their_yaml_does() -> None:
    data = {
        "schema": 1,
        "name": "test",
        "duration": "10 s",
        "buses": [{"name": "link", "nn": True}],
        "plcs": (
            {
                "name": "press1",
                "scan": "8 ms",
                "nn": {"bus": "link", "port": "COM4", "station": 0, "slaves": 2, "timeout": "50 ms"},
            },
            {"name": "press2", "scan": "5 ms", "nn": {"bus": "link", "port": "COM4", "station": 1}},
            {"name": "press3", "scan": "5 ms", "nn": {"bus": "link", "port": "COM4", "station": 2}},
        ),
    }
    assert from_data(data) == loads(BASE)


def test_numbers_of_numpy_are_numbers() -> None:
    import numpy as np

    data = {**loads(BASE).source, "seed": np.int64(5), "noise": [{"bus": "link", "ber": np.float64(0.5)}]}
    found = from_data(data)
    assert (found.seed, found.noise[0].kind) == (5, model.BitErrors(0.5))


def test_mistakes_in_plain_data_have_their_full_names() -> None:
    data = dict(loads(BASE).source)
    wrong = {"name": "press1", "nn": {"bus": "link", "station": 9}}
    data["plcs"] = [wrong, {"name": "press1"}, {"name": 5}]
    data["noise"] = [{"bus": "lnk", "ber": 1}]
    with pytest.raises(ScenarioError) as caught:
        from_data(data)
    assert str(caught.value).splitlines() == [
        "<data>: noise.0.bus is 'lnk', which is no bus; did you mean link?",
        "<data>: plcs.0.nn.station is 9, allowed 0..7",
        "<data>: plcs.1.name is 'press1', which is used already (plcs.0.name)",
        "<data>: plcs.2.name is 5, not a name; allowed are letters, digits, _ and -, with at least one letter",
    ]


def test_plain_data_that_contain_themselves() -> None:
    data: dict[str, object] = {}
    data["x"] = data
    with pytest.raises(ScenarioError, match="nested deeper than 30 levels"):
        from_data(data)


def test_plain_data_of_the_wrong_kind() -> None:
    with pytest.raises(ScenarioError, match=r"<data>: a scenario is a mapping with .* this is a list"):
        from_data([])  # type: ignore[arg-type]
    with pytest.raises(ScenarioError, match="a key is 5; keys must be text"):
        from_data({5: 1})  # type: ignore[dict-item]
    with pytest.raises(ScenarioError, match="seed is of the type set, expected a whole number"):
        from_data({**loads(BASE).source, "seed": {1}})
    with pytest.raises(ScenarioError, match="is empty"):
        from_data(None)  # type: ignore[arg-type]


def test_a_scenario_cannot_be_changed() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        loads(BASE).seed = 3  # type: ignore[misc]
