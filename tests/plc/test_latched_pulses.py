"""PLS and PLF over STOP and over a power loss, from the FX manual's words on battery backed relays.

FX programming manual, 2.16 (from memory): with its input still on over RUN, STOP, RUN PLS of a general relay
pulses again, that of a latched one does not; its input must have gone off before.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from bussim.line.random_streams import Streams
from bussim.plc.plc import Plc, PlcState
from bussim.plc.profiles import PROFILES
from bussim.plc.program.program import Program

#: M700 and M701 are inputs that stay; D300–D303 count the pulses.
TEXT = """
LD M700
PLS M0
PLS M600
LD M701
PLF M601
LD M0
INC D300
LD M600
INC D301
LD M601
INC D302
LDP M700
INC D303
LD M700
INCP D304
END
"""


def plc(*, again: bool) -> Plc:
    made = Plc(
        "press",
        replace(PROFILES["fx2n"], latched_pulse_again=again),
        scan_mean=1000,
        scan_jitter=0,
        phase=500,
        registers={},
        sources={},
        linked=False,
        streams=Streams(1),
        program=Program.parse(TEXT, "p.il"),
    )
    made.power_on()
    return made


def counts(tested: Plc) -> list[int]:
    return [tested.read(f"D{number}") for number in range(300, 305)]


def scans(tested: Plc, now: int, count: int) -> int:
    """Carry out so many ENDs from a tick on, in RUN; returns the tick after the last."""
    if tested.state is not PlcState.RUN:
        tested.run(now, traced=False)
    for _ in range(count):
        end = tested.wanted_end(now)
        assert end is not None
        tested.end(end)
        now = end + 1
    return now


@pytest.mark.parametrize("supply", [False, True])
@pytest.mark.parametrize("again", [False, True])
def test_a_latched_relay_pulses_again_only_after_its_input_was_off(*, again: bool, supply: bool) -> None:
    tested = plc(again=again)
    m = tested.memory.bits("M")
    m[700] = m[701] = 1
    now = scans(tested, 0, 2)
    assert counts(tested) == [1, 1, 0, 1, 1]
    tested.stop(now)
    if supply:
        tested.power_off(now)
        tested.power_on(now)
    m = tested.memory.bits("M")
    m[701] = 0
    now = scans(tested, now, 2)
    # General relays, contacts and P forms begin anew; so does PLF, which then has seen no input that was on.
    assert counts(tested) == [2, 1 + again, 1 - again, 2, 2]
    for level in (0, 1):
        m[700] = level
        now = scans(tested, now, 2)
    assert counts(tested) == [3, 2 + again, 1 - again, 3, 3]
