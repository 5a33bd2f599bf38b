"""Random links, noise and goals for tests of sizing."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import strategies as st

from bussim.exact.link import LineNoise, LinkModel, NoiseSource
from bussim.exact.sizing.goals import Goals
from bussim.plc.profiles import Attempts, Turnaround
from tests.exact.links import FULL, MS, PROBE, change, link


@st.composite
def links(draw: st.DrawFn) -> LinkModel:
    """Links of all sizes and modes, with slow stations, other readings and other policies; without noise."""
    slaves = draw(st.integers(1, 7))
    turnaround = Turnaround(draw(st.integers(20_000, 200_000)), draw(st.integers(0, 10_000)))
    absent = draw(st.sampled_from([FULL, PROBE]))
    model = link(slaves, mode=draw(st.integers(0, 4)), absent=absent, turnaround=turnaround)
    model = replace(model, reading=draw(st.sampled_from(list(Attempts))))
    slow = draw(st.integers(1, slaves))
    return change(model, slow, extra=draw(st.integers(0, 30)) * MS, scan=draw(st.integers(1, 60)) * MS)


@st.composite
def noisy(draw: st.DrawFn) -> tuple[LinkModel, str, int | None]:
    """A link, and a place of noise on it."""
    model = draw(links())
    part = draw(st.sampled_from(["bus", "bus", "rx", "tx"]))
    station = None if part == "bus" else draw(st.integers(0, len(model.stations)))
    return model, part, station


def with_rate(line: tuple[LinkModel, str, int | None], ber: float) -> LinkModel:
    model, part, station = line
    return replace(model, noise=LineNoise((NoiseSource(part, station, ber),) if ber else ()))


@st.composite
def goal_texts(draw: st.DrawFn) -> list[str]:
    """Some goals as a user writes them."""
    unit = st.sampled_from(["y", "d", "h"])
    ms = st.integers(20, 900)
    forms = {
        "errors": st.builds("errors<={}/{}".format, st.sampled_from([0.01, 0.1, 1, 5, 250]), unit),
        "onsets": st.builds("onsets<={}/{}".format, st.sampled_from([0.01, 0.5, 1, 20]), unit),
        "scan": st.builds("scan<={}ms@{}".format, ms, st.sampled_from(["0.1", "0.001", "1e-06"])),
        "dead": st.builds("dead<={}ms".format, ms),
        "ride": st.builds("ride>={}ms".format, st.integers(1, 600)),
        "heartbeat": st.builds("heartbeat={}ms@{}/y".format, ms, st.sampled_from([0.1, 10])),
    }
    names = draw(st.lists(st.sampled_from(list(forms)), min_size=1, max_size=4, unique=True))
    return [draw(forms[name]) for name in names]


def goals_of(texts: list[str]) -> Goals:
    goals = Goals()
    for text in texts:
        goals = goals.with_text(text)
    return goals
