"""What a line on the page cannot tell is not told: counts that limit nothing, links that are not there."""

from __future__ import annotations

from pathlib import Path

import pytest

from bussim.scenario import builtin
from tests.ui.asking import EXAMPLE, Page


@pytest.fixture
def page(tmp_path: Path) -> Page:
    return Page(tmp_path)


@pytest.mark.parametrize(
    ("master", "unlimited"),
    [({}, ["slave1", "slave2", "slave3"]), ({"1": 0, "2": 1}, ["slave3"]), ({"1": 0, "2": 1, "3": 0}, [])],
)
def test_what_counts_do_not_limit_is_told(page: Page, master: dict[str, int], unlimited: list[str]) -> None:
    slaves = {str(station): 40 + station for station in (1, 2, 3)}
    found = page.ask("counters", text=EXAMPLE, watched_h=168, master=master, slaves=slaves)
    assert found["unlimited"] == unlimited


def test_a_station_that_is_on_again_leaves_the_text_as_it_was(page: Page) -> None:
    assert page.ask("edit", text=EXAMPLE, form={"off": []})["text"] == EXAMPLE
    off = page.ask("edit", text=EXAMPLE, form={"off": ["slave1"]})["text"]
    assert "power_off: slave1" in off
    assert page.ask("check", text=page.ask("edit", text=off, form={"off": []})["text"])["form"]["off"] == []


def test_a_scenario_without_a_link_has_what_is_recommended_for_its_ports(page: Page) -> None:
    def ports(name: str) -> dict[str, dict[str, object]]:
        text = (builtin.folder() / f"{name}.yaml").read_text("utf-8")
        found = page.ask("size", text=text, goals=["errors<=1/y", "ride>=100ms"])
        assert found["sizing"] is None
        return dict(found["ports"])

    best = ports("default_timeout")["server"]["recommended"]
    assert isinstance(best, dict)
    assert (best["timeout_ms"], best["retries"]) == (50.0, 3)
    collide = ports("two_masters")["filler.COM3"]
    assert collide["recommended"] is None
    assert collide["reasons"] == ["packer.COM3 also asks on meters: requests and responses collide"]
