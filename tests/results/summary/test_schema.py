"""Summaries of others are checked by the keys that readers need, before anything is read of them."""

from __future__ import annotations

import copy
import io
import json
import random
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from bussim.errors import UsageError
from bussim.report.page import report_page
from bussim.report.runs import Source
from bussim.results.run_record import RunRecord
from bussim.results.store.folder import HISTOGRAMS, SUMMARY
from bussim.results.store.load import load_run
from bussim.results.summary.schema import check_summary
from bussim.results.text.run import show_result

TESTS = Path(__file__).parents[2]
RECORDED = sorted((TESTS / "recorded").glob("*.json"))
STORED = sorted((TESTS / "results" / "stored").iterdir())
ODD: list[Any] = [None, True, -1, 1.5, "x", [], {}, [1], {"a": 1}, 10**30, 1e300, "\x1b[31m", [[1]]]


def test_what_every_version_writes_is_accepted() -> None:
    assert len(RECORDED) > 30
    for path in RECORDED:
        check_summary({"bussim": "1", **json.loads(path.read_text(encoding="utf-8"))}, "")
    for run in STORED:
        check_summary(json.loads((run / SUMMARY).read_text(encoding="utf-8")), "")


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("scenario",), ..., "scenario is missing"),
        (("links", "link", "scan_time_ms", "max"), ..., "links.link.scan_time_ms.max is missing"),
        (("links", "link", "scans"), "9", "links.link.scans is '9', not a whole number"),
        (("links", "link", "bus_load"), None, "links.link.bus_load is null, not a number"),
        (("links", "link", "bus_load"), True, "links.link.bus_load is true, not a number"),
        (("links", "link", "polls"), 10**30, "links.link.polls is 10{30}, not a whole number"),
        (("links",), [], "links is a list, not an object"),
        (("rests_on",), {"links": {"link": {"text": 1}}}, "rests_on.links.link.inputs is missing"),
        (("verdict",), [{"key": "x"}], "verdict.0.text is missing"),
        (("verdict",), [{"key": "x", "text": "y", "values": {"bus": []}}], "verdict.0.values.bus is a list"),
        (("warnings",), [3], "warnings.0 is 3, not a text"),
        (("latency", "door-to-press1", "ms", "mean"), [], "door-to-press1.ms.mean is a list, not a number"),
        (
            ("plcs", "press1", "registers", "D8173"),
            0.5,
            "plcs.press1.registers.D8173 is 0.5, not a whole num",
        ),
    ],
)
def test_the_key_at_fault_is_named(path: tuple[str, ...], value: Any, message: str) -> None:
    data = json.loads((STORED[1] / SUMMARY).read_text(encoding="utf-8"))
    inner = data
    for key in path[:-1]:
        inner = inner[key]
    if value is ...:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    with pytest.raises(ValueError, match=message):
        check_summary(data, "")


def test_keys_of_a_later_version_may_hold_anything() -> None:
    data = json.loads((STORED[1] / SUMMARY).read_text(encoding="utf-8"))
    data["weather"] = data["links"]["link"]["phase"] = data["plcs"]["press1"]["x"] = [None]
    check_summary(data, "")


def places(data: Any) -> list[tuple[Any, Any]]:
    """Every key of plain data, with what it is in."""
    pairs = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    return [place for key, inner in pairs for place in ((data, key), *places(inner))]


def changed(data: Any, chance: random.Random) -> Any:
    """Plain data of which one key is missing, or has an odd value."""
    data = copy.deepcopy(data)
    inner, key = chance.choice(places(data))
    if chance.random() < 0.3:
        del inner[key]
    else:
        inner[key] = chance.choice(ODD)
    return data


def shown(record: RunRecord, *, page: bool) -> str:
    output = io.StringIO()
    show_result(Console(file=output, width=120), record, {})
    if page:
        output.write(report_page([Source("run", "run", record, "")]))
    return output.getvalue()


@pytest.mark.parametrize(
    ("name", "most", "page"),
    [
        (SUMMARY, 50, False),
        pytest.param(SUMMARY, 200, True, marks=pytest.mark.slow),
        pytest.param(HISTOGRAMS, 200, True, marks=pytest.mark.slow),
    ],
)
def test_changed_files_are_read_or_refused(name: str, most: int, page: bool, tmp_path: Path) -> None:
    chance = random.Random(1)
    files = [
        [json.loads((run / each).read_text(encoding="utf-8")) for each in (SUMMARY, HISTOGRAMS)]
        for run in STORED
    ]
    read = 0
    for _ in range(most):
        pair = dict(zip((SUMMARY, HISTOGRAMS), chance.choice(files), strict=True))
        for each, data in {**pair, name: changed(pair[name], chance)}.items():
            (tmp_path / each).write_text(json.dumps(data), encoding="utf-8")
        try:
            record = load_run(tmp_path)
        except UsageError as error:
            assert str(tmp_path / name) in str(error)
            assert str(error).isprintable()
        else:
            assert "\x1b" not in shown(record, page=page)
            read += 1
    assert 0 < read < most
