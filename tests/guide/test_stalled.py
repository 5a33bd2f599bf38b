"""Reports of stalled polling, rebuilt: what the guide says that they cost, and what helps, is what comes out."""

from __future__ import annotations

import math
from typing import Any

import pytest

import bussim
from bussim.units import TICKS_PER_MS
from tests.guide.pages import ROOT

#: The scenarios and the devices that are off in them.
REPORTS = {
    "unplugged_thermostat": ("thermostat",),
    "frozen_hub": ("third",),
    "default_timeout": ("s7", "s8"),
    "missing_server": ("battery3",),
    "one_of_twenty_off": ("device7",),
    "slave_down_at_rapid_pace": ("unit2",),
}
PAGES = tuple(ROOT / "bussim" / "guide" / place for place in ("stalled.md", "zh/stalled.md"))


def whole(value: float) -> str:
    """A time in ms, rounded up."""
    return f"{math.ceil(round(value, 6)):,}"


def as_it_is(name: str) -> dict[str, Any]:
    """What the settings of the report cost: the entry of the devices that are off in its poll list."""
    (found,) = bussim.exact(name).to_dict()["polls"].values()  # type: ignore[attr-defined]
    entries = [*found["dead"].values(), *found["more_dead"]]
    count = len(REPORTS[name])
    dead = next(
        each
        for each in entries
        if set(each["devices"]) == set(REPORTS[name]) or count == 2 == len(each["devices"])
    )
    return {"cycle": found["cycle_ms"]["max"], "timeout": found["timeout_ms"], **dead}


def row(name: str) -> str:
    """The report's row of the guide's table."""
    now = as_it_is(name)
    (sizing,) = bussim.size(name).ports.values()
    best = sizing.recommended
    assert best is not None
    then = best.two_dead if len(REPORTS[name]) == 2 else best.dead_longest
    assert then is not None
    skipped = [each.setting.dead for each in sizing.remedies if "skip_after_failure" in each.text]
    cells = (
        f"{now['attempts']} × {now['timeout']:,g} = {now['lost_ms']:,g}",
        f"{whole(now['cycle'])}",
        whole(now["cycle_ms"]["max"]),
        f"{best.timeout / TICKS_PER_MS:g} / {best.retries}",
        whole(then / TICKS_PER_MS),
        whole(skipped[0] / TICKS_PER_MS) if skipped and skipped[0] else "–",
    )
    return f"| `{name}` | {' | '.join(cells)} |"


@pytest.mark.parametrize("name", REPORTS)
def test_the_guide_has_the_figures_of_size(name: str) -> None:
    said = row(name)
    for page in PAGES:
        assert said in page.read_text(encoding="utf-8").splitlines(), said


@pytest.mark.parametrize("name", REPORTS)
def test_size_has_the_setting_of_the_report_among_others_and_a_cheaper_one(name: str) -> None:
    now = as_it_is(name)
    (sizing,) = bussim.size(name).ports.values()
    retries = now["attempts"] // len(now["polls"]) - 1
    (same,) = [
        each
        for each in sizing.table
        if each.retries == retries and each.timeout == now["timeout"] * TICKS_PER_MS
    ]
    entries = (*same.figures.dead, *same.figures.more_dead)
    (found,) = (each.cycle.most for each in entries if list(each.devices) == now["devices"])
    assert found / TICKS_PER_MS == pytest.approx(now["cycle_ms"]["max"], abs=1e-5)  # the same pause, too
    assert sizing.recommended is not None
    cheaper = [sizing.recommended, *(each.setting for each in sizing.remedies)]
    assert found > 2 * min(each.dead or 0 for each in cheaper)


@pytest.mark.parametrize("name", REPORTS)
def test_a_run_shows_what_the_report_tells(name: str) -> None:
    now = as_it_is(name)
    (seen,) = bussim.run(name, rows=False).record.ports.values()
    longest = (seen.cycles.maximum or 0) / TICKS_PER_MS
    assert now["cycle_ms"]["min"] <= longest <= now["cycle_ms"]["max"]


def test_attempts_of_a_client_above_a_gateway_multiply() -> None:
    (found,) = (
        bussim.exact(bussim.load("one_of_twenty_off", ["devices.gateway.polls.d7.retries=11"]))
        .to_dict()["polls"]
        .values()
    )  # type: ignore[attr-defined]
    dead = found["dead"]["device7"]
    assert (dead["attempts"], dead["lost_ms"]) == (12, 6000)
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        assert "12 × 500 = 6,000" in text
        assert whole(dead["cycle_ms"]["max"]) in text
