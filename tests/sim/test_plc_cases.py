"""Single PLCs and short links, device by device over time, against what the manuals say of them."""

from __future__ import annotations

from itertools import pairwise

import pytest

from bussim.scenario.loader import loads
from bussim.sim.runner import simulate
from tests.sim.build import MS, SECOND, Recorder
from tests.sim.plc_links import examine_text, link, watched

MEMORY = """
schema: 1
name: what memory keeps
duration: 6 s
seed: 1
plcs:
  - name: p
    profile: fx2n
    scan: 5 ms
    inputs: {X0: {pulse: {width: 350 ms, at: 1 s}}}
    program: |
      LDP X0
      MOV K11 D10
      MOV K22 D300
      SET M10
      SET M1064
      SET S600
      SET S10
      LD X0
      OUT C0 K1
      OUT C100 K1
      OUT T250 K30
      LD M1064
      OUT Y0
      END
faults:
  - {at: 3 s, for: 1 s, FAULT: p}
"""


@pytest.mark.parametrize("kind", ["power_off", "stop"])
def test_general_devices_begin_anew_and_latched_ones_go_on(kind: str) -> None:
    names = "p.D10 p.M10 p.S10 p.CN0 p.C0 p.D300 p.M1064 p.S600 p.CN100 p.C100 p.TN250 p.Y0"
    seen = watched(MEMORY.replace("FAULT", kind), names)
    before = [seen[name].at(3 * SECOND - 1) for name in names.split()]
    assert before == [11, 1, 1, 1, 1, 22, 1, 1, 1, 1, 3, 1]
    back = seen["p.Y0"].ticks[-1]  # the first END after RUN
    assert 4 * SECOND < back <= 4 * SECOND + 6 * MS
    # Outputs go off with the supply or RUN; a monitor sees what memory has lost when it is back, or at STOP.
    cleared = (3 if kind == "stop" else 4) * SECOND
    assert seen["p.Y0"].between(2 * SECOND, back) == [(3 * SECOND, 0)]
    for name in ("p.D10", "p.M10", "p.S10", "p.CN0", "p.C0"):
        assert seen[name].between(2 * SECOND, back) == [(cleared, 0)], name
    after = [seen[name].at(back) for name in names.split()]
    assert after == [0, 0, 0, 0, 0, 22, 1, 1, 1, 1, 3, 1]


def test_a_returning_station_copies_latched_bits_although_it_asks_for_the_error_flag() -> None:
    """M8183 of the master is off after RUN: LDI M8183 lets the old M1000 through at the first END."""
    seen = watched(link(), "s1.Y10 s1.Y13 s1.M1000 s1.M8191 m.Y14 m.Y15")
    running = seen["s1.M8191"].between(6 * SECOND, 9 * SECOND)
    first_end = 7 * SECOND + 6 * MS
    assert seen["s1.Y10"].at(first_end) == seen["s1.Y13"].at(first_end) == 1
    assert [value for _, value in running] == [0, 1]
    assert running[0][0] <= first_end < running[1][0]
    away, back = seen["s1.Y10"].between(SECOND * 3 // 2, 10 * SECOND)
    assert away == (6 * SECOND, 0)  # outputs are off without supply
    assert back[1] == 1
    assert seen["m.Y15"].at(6 * SECOND) == 1


# -- special devices that live by themselves -----------------------------------------------------------------

PLAIN = """
schema: 1
name: PLCs without a program
duration: 50 s
seed: 1
buses: [{name: link, nn: true}, {name: b, baud: 19200}]
plcs:
  - name: m
    scan: {mean: 5 ms, jitter: 1 ms}
    nn: {bus: link, port: COM4, station: 0, slaves: 1, mode: 2}
    ports: {COM2: {bus: b, protocol: modbus-rtu-slave, station: 1}}
    registers: {D8013: 50, D8014: 59, D8015: 23, D8016: 31, D8017: 12, D8018: 29}
  - {name: s, scan: 5 ms, nn: {bus: link, port: COM4, station: 1}}
devices:
  - {name: other, model: lx, bus: b, station: 2, scan: 7 ms}
  - name: pc
    model: hmi
    bus: b
    timeout: 200 ms
    polls:
      - {name: run, station: 1, function: 1, address: 8000, count: 15, every: 170 ms, at: 500 ms}
      - {name: words, station: 1, function: 3, address: 8000, count: 20, every: 170 ms, at: 600 ms}
      - {name: more, station: 1, function: 3, address: 8101, count: 1, every: 170 ms, at: 600 ms}
      - {name: lx-run, station: 2, function: 1, address: 8000, count: 15, every: 170 ms, at: 600 ms}
      - {name: lx-words, station: 2, function: 3, address: 8000, count: 20, every: 170 ms, at: 600 ms}
"""


def replies(text: str) -> dict[str, list[tuple[int, list[int]]]]:
    """What each poll got: when it was served, and its values (coils as bits)."""
    record = Recorder()
    simulate(loads(text), record)
    frames = {frame.start: frame.chars for frame in record.frames}
    found: dict[str, list[tuple[int, list[int]]]] = {}
    for each in record.transactions:
        assert each.outcome == "ok"
        assert each.served is not None
        assert each.answer_start is not None
        data = frames[each.answer_start][3:-2]
        if each.function == 1:
            values = [data[number // 8] >> number % 8 & 1 for number in range(each.quantity)]
        else:
            values = [data[at] << 8 | data[at + 1] for at in range(0, len(data), 2)]
        found.setdefault(each.poll, []).append((each.served, values))
    return found


@pytest.fixture(scope="module")
def polled() -> dict[str, list[tuple[int, list[int]]]]:
    return replies(PLAIN)


@pytest.mark.parametrize("name", ["run", "lx-run"])
def test_the_run_bits_and_clocks_of_a_plc_without_a_program(
    polled: dict[str, list[tuple[int, list[int]]]], name: str
) -> None:
    seen = set()
    for served, bits in polled[name]:
        assert bits[:4] == [1, 0, 0, 1]
        for bit, period in zip(bits[11:15], (10, 100, 1000, 60_000), strict=True):
            # The END that serves a request is the beginning of the scan whose clocks are shown.
            assert bit == (served % (period * MS) < period * MS // 2)
        seen.add(tuple(bits[11:15]))
    assert len(seen) == 16


@pytest.mark.parametrize("name", ["words", "lx-words"])
def test_the_words_of_a_plc_without_a_program(
    polled: dict[str, list[tuple[int, list[int]]]], name: str
) -> None:
    shortest, longest = 1 << 16, 0
    for served, words in polled[name]:
        assert words[0:2] == [200, 25010]
        latest, least, most = words[10:13]
        if name == "words":
            # 5 ms ± 1 ms and ten per cent, and 0.2 ms for a transaction; of so many scans the extremes are near.
            assert 44 <= least <= latest <= most <= 68
            assert least <= shortest
            assert most >= longest
            shortest, longest = least, most
            clock = [(50 + served // SECOND) % 60, 59, 23, 31, 12, 29, 1]  # a Monday
            if served >= 10 * SECOND:
                clock[1:] = [(served - 10 * SECOND) // (60 * SECOND), 0, 1, 1, 30, 2]
            assert words[13:20] == clock
        else:
            assert (latest, least, most) == (70, 70, 70)
            assert words[13:20] == [served // SECOND % 60, served // SECOND // 60, 0, 1, 1, 0, 6]
    if name == "words":
        assert (shortest, longest) == (44, 67)
    assert {words[0] for _, words in polled["more"]} == {16003}


def test_observed_devices_of_a_plc_without_a_program() -> None:
    text = PLAIN.replace("50 s", "2 s") + "faults: [{at: 1 s, for: 300 ms, stop: s}]\n"
    seen = watched(text, "s.M8000 s.M8001 s.M8002 s.M8003 s.M8013 s.D8010 s.D8012 s.D8000 s.D8101")
    values = {name.removeprefix("s."): each.values for name, each in seen.items()}
    assert values["M8000"] == [1, 0, 1]  # off in STOP
    assert values["M8001"] == [1, 0]
    assert values["M8002"] == [1, 0, 1, 0]  # the first scan, after each RUN
    assert values["M8003"] == [1, 0, 1]
    assert values["M8013"] == [1, 0, 1, 0]
    assert values["D8010"] == values["D8012"] == [55, 0, 55]
    assert (values["D8000"], values["D8101"]) == ([200], [16003])


@pytest.mark.parametrize("program", ["", "    program: {text: END}\n"])
@pytest.mark.parametrize(
    ("clock", "why"),
    [
        ("D8017: 13", "month must be in 1..12"),
        ("D8013: 75", "second must be in 0..59"),
        ("D8016: 30, D8017: 2", "day 30 must be in range 1..29 for month 2 in year 2000"),
    ],
)
def test_a_bad_clock_is_a_mistake(clock: str, why: str, program: str) -> None:
    whole = "D8013: 50, D8014: 59, D8015: 23, D8016: 31, D8017: 12, D8018: 29}\n"
    found = examine_text(PLAIN.replace(whole, f"{clock}}}\n{program}"))
    (message,) = [problem.message for problem in found]
    assert message.startswith("m: D8013 to D8018 are no time: ")
    # The reason is Python's, whose words differ between versions.
    assert message.endswith(why) or why.split()[0] in message


ERRORS = """
schema: 1
name: an error in a program
duration: 1 s
seed: 1
plcs:
  - name: p
    scan: 10 ms
    inputs: {X0: {times: [100 ms]}}
    program: |
      LD X0
      DIV K5 D9 D20    ; D9 is 0
      LD M8004
      OUT Y1
      MOV D8004 D0
      MOV D8013 D1
      END
"""


def test_m8004_and_d8004_name_the_error_flag_that_is_on() -> None:
    seen = watched(ERRORS, "p.M8004 p.D8004 p.M8067 p.Y1 p.D0")
    ticks = {tuple(each.ticks) for each in seen.values()}
    assert len(ticks) == 1  # all at the END of the scan with the division
    assert 100 * MS <= seen["p.M8004"].ticks[0] <= 121 * MS
    assert [each.values for each in seen.values()] == [[1], [8067], [1], [1], [8067]]


# -- timers and counters -------------------------------------------------------------------------------------

COUNTER = """
schema: 1
name: a 32-bit counter beyond its preset
duration: 1 s
seed: 1
plcs:
  - name: p
    profile: fx3u
    scan: 10 ms
    inputs: {X0: {pulse: {width: 30 ms, at: 200 ms, every: 60 ms, times: 2}}, X1: {times: [100 ms]}}
    program: |
      LD X0
      OUT C200 K10
      LDP X1
      DMOV K20 C200
      END
"""


TIMERS = """
schema: 1
name: timers of a subroutine that is called once
duration: 2 s
seed: 1
plcs:
  - name: p
    profile: fx3u
    scan: 10 ms
    inputs: {X0: {pulse: {width: 100 ms, at: 100 ms}}, X1: {times: [1500 ms]}}
    program: |
      LDP X0
      ORP X1
      CALL P1
      LD T192
      OUT Y1
      LD T246
      OUT Y2
      FEND
      P1
      LD M8000
      OUT T192 K3
      LD M8000
      OUT T246 K300
      SRET
      END
"""


def test_a_32_bit_counter_beyond_its_preset_does_not_close() -> None:
    seen = watched(COUNTER, "p.CN200 p.C200")
    assert seen["p.CN200"].values == [20, 21, 22]
    assert seen["p.C200"].values == []


def test_timers_of_a_subroutine_go_on_without_a_call() -> None:
    """T192 closes at END; T246 closes at its next coil, which comes with the call at 1.5 s."""
    seen = watched(TIMERS, "p.TN192 p.T192 p.TN246 p.T246 p.Y1 p.Y2")
    assert seen["p.TN192"].values == [1, 2, 3]
    assert seen["p.TN246"].values[-1] == 300
    assert all(0 < after - before <= 13 for before, after in pairwise(seen["p.TN246"].values))
    (closed,) = seen["p.T192"].ticks
    assert closed == seen["p.TN192"].ticks[-1]
    assert 300 * MS < closed <= 420 * MS
    (lamp,) = seen["p.Y1"].ticks
    assert closed < lamp <= closed + 12 * MS
    reached = seen["p.TN246"].ticks[-1]
    assert 400 * MS <= reached <= 425 * MS
    (late,) = seen["p.T246"].ticks
    assert 1500 * MS < late <= 1521 * MS
    assert late < seen["p.Y2"].ticks[0] <= late + 12 * MS or seen["p.Y2"].ticks[0] == late
