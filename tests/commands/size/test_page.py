"""The page with sliders: its figures are the solver's, rounded to the safe side."""

from __future__ import annotations

import json
import math
import re
from itertools import product
from pathlib import Path
from typing import Any

import pytest

import bussim
from bussim.cli import main
from bussim.commands.size.uniform_link import uniform_link
from bussim.exact.sizing.assumptions import assumptions
from bussim.exact.sizing.choice import recommend
from bussim.exact.sizing.goals import Goals
from bussim.exact.sizing.noise_levels import with_level
from bussim.exact.sizing.page.items import Detail, page_items
from bussim.exact.solve import Solved
from bussim.exact.text import a_year
from bussim.plc.profiles import AbsentStation, Attempts
from bussim.scenario import builtin
from bussim.units import TICKS_PER_MS
from bussim.words.language import shown, use_language
from bussim.words.tables import Said
from tests.commands.size.test_ports import LINE

SMALL = Detail(timeouts=3, points=12)

_RIDE = "an interruption of the line of 100 ms without a station error"


def payload(path: Path) -> dict[str, Any]:
    text = path.read_text(encoding="utf-8")
    found = re.search(r'<script type="application/json" id="payload">(.*?)</script>', text, re.DOTALL)
    assert found is not None
    result: dict[str, Any] = json.loads(found[1])
    return result


def at(table: list[Any], *place: int) -> Any:
    """A value of a packed table: an axis of one entry is the same all along."""
    found: Any = table
    for index in place:
        found = found[0 if len(found) == 1 else index]
    return found


def test_figures_of_a_link_are_those_of_its_json() -> None:
    sized = bussim.size(uniform_link(3, 1, ber=1e-5))
    (item,) = page_items(sized, SMALL)
    found = json.loads(json.dumps(sized.to_dict()))["links"]["link"]
    judged = item["start"][2]
    assert item["noises"][judged]["name"] == "judged"
    best = found["recommended"]
    assert [item["retries"][item["start"][0]], item["units"][item["start"][1]]] == [
        best["D8179"],
        best["D8180"],
    ]
    some = [choice for choice in found["pareto"] if choice["D8180"] in item["units"]]
    assert len(some) > 5
    for choice in some:
        place = judged, choice["D8179"], item["units"].index(choice["D8180"])
        shown = {name: at(table, *place) for name, table in item["figures"].items()}
        for name, key in (("mean", "mean_ms"), ("dead", "one_dead_ms")):
            assert 0 <= shown[name] - choice[key] < 0.1 + 1e-9
        assert 0 <= shown["detect"] - choice["detect_ms"]["mean"] < 0.1 + 1e-9
        assert shown["ride"] == math.floor(choice["ride_through_ms"])
        errors = choice["false_errors_per_year"]
        assert shown["errors"] == (float(a_year(errors, 1.0).replace(",", "")) if errors >= 1e-9 else 0)
        goals = [
            each["text"] for bit, each in enumerate(item["goals"]) if at(item["missed"], *place) >> bit & 1
        ]
        assert goals == [
            *(["false station errors: at most 1 a year"] if errors > 1 else []),
            *([_RIDE] if choice["ride_through_ms"] < 100 else []),
        ]


def test_the_distribution_is_the_law_and_never_below_it() -> None:
    scenario = uniform_link(3, 1)
    sized = bussim.size(scenario)
    (item,) = page_items(sized, SMALL)
    model = sized.links["link"].model
    for noise, retries, timeout in product((1, 2, 4), (0, 4, 10), (0, 2)):
        rate = 1 / item["noises"][noise]["value"]
        ticks = round(item["timeouts"][timeout] * TICKS_PER_MS)
        law = Solved(with_level(model, rate).with_setting(retries + 1, ticks)).distribution
        certain, *rest = at(item["over"], noise, retries, timeout)
        shown = [1.0] * (certain + 1) + rest
        for index, x in enumerate(item["x"]):
            exact = float(law.tail(float(round(x * TICKS_PER_MS))))
            p = shown[index] if index < len(shown) else 0
            assert p >= exact * (1 - 2e-3) - 2e-9
            assert p <= 1.11 * exact + 2e-9 or exact < 1e-8


def test_figures_of_a_poll_list_are_those_of_its_table(tmp_path: Path) -> None:
    path = tmp_path / "meters.yaml"
    path.write_text(LINE, encoding="utf-8")
    sized = bussim.size(path, ["dead<=300ms"])
    (item,) = page_items(sized)
    table = [setting.to_json() for setting in sized.ports["p.COM3"].table]
    for row in json.loads(json.dumps(table)):
        place = item["start"][2], row["retries"], item["timeouts"].index(row["timeout_ms"])
        shown = {name: at(figures, *place) for name, figures in item["figures"].items()}
        named = (
            ("mean", row["cycle_ms"]),
            ("dead", row["one_dead_ms"]["mean_at_most"]),
            ("dead_longest", row["one_dead_ms"]["max"]),
            ("two_dead", row["two_dead_ms"]),
            ("age", row["age_ms"]),
        )
        for name, exact in named:
            assert 0 <= shown[name] - exact < 0.1 + 1e-9, name
        errors = row["failed_turns_per_year"]
        assert shown["errors"] == (None if errors is None else float(a_year(errors, 1.0).replace(",", "")))
        missed = at(item["missed"], *place)
        assert bool(missed & 1) == (errors is None or errors > 1)
        assert bool(missed & 2) == (row["one_dead_ms"]["mean_at_most"] > 300)
    device, polls = item["costly"]
    assert (device in {"s1", "s2"}, polls) == (True, 1)
    lost = at(item["figures"]["lost"], 0, 2, len(item["timeouts"]) - 1)
    assert lost == 3 * item["timeouts"][-1]
    assert item["program"][1:] == ["MOV K{units} D7929", "MOV K50 D7922"]
    assert "retries={retries}" in item["pymodbus"][0]


def assert_chinese(text: str) -> None:
    """A text has a Chinese form without English words but names and keys of a scenario."""
    assert isinstance(text, Said)
    with use_language("zh"):
        assert not re.search(
            r"(?<!\w)(?!D8179|D8180|END|ms|bad|typical)[A-Za-z]{3}[a-z]*(?![\w<>=])",
            _KEYS.sub("", shown(text)),
        ), shown(text)


_KEYS = re.compile(r"absent_station：\w+|(dead|ride|errors|onsets)[<>]=\S+")


def test_a_list_that_cannot_be_sized_and_a_goal_that_is_not_judged_have_their_remarks(tmp_path: Path) -> None:
    path, target = tmp_path / "storm.yaml", tmp_path / "storm.html"
    storm = "noise: [{name: storm, bus: b, burst: {good: 1 s, bad: 20 ms, ber_good: 0, ber_bad: 0.01}}]"
    path.write_text(f"{LINE}{storm}\n", encoding="utf-8")
    assert main(["size", str(path), "-o", str(target)]) == 1
    (item,) = payload(target)["items"]
    assert (item["valid"], item["notes"]) == (
        False,
        ["storm comes and goes: attempts do not fail independently"],
    )
    found = payload(target)["sentences"]
    assert found[item["notes"][0]] == "storm 时有时无：各次尝试的失败互相关联"
    (item,) = page_items(bussim.size(uniform_link(2, 0), ["heartbeat=2s@1/y", "ride>=0"]), SMALL)
    assert [each["name"] for each in item["goals"]] == ["errors"]
    assert item["beside"] == ["a heartbeat of 2 s missed at most once a year"]
    (item,) = page_items(bussim.size(uniform_link(2, 0), ["dead<=20ms"]), SMALL)
    retries, timeout, judged = item["start"]
    assert item["recommended"][judged] is None
    assert ["a scan of at most 20 ms with one station dead"] in item["unmet"]
    for each in item["remedies"]:
        assert_chinese(each)
    assert at(item["missed"], judged, retries, timeout) > 0


def test_less_noise_leaves_fewer_failed_turns_and_more_leaves_more() -> None:
    items = page_items(bussim.size("feeder_off"))
    errors = [at(items[0]["figures"]["errors"], noise, 1, 1) for noise in range(5)]
    assert errors == sorted(errors)
    assert errors[0] < errors[2] < errors[4]


def test_every_assumption_is_there_in_chinese() -> None:
    for reading, absent, ber in product(Attempts, AbsentStation, (None, 1e-6)):
        (sizing,) = bussim.size(uniform_link(3, 1, ber=ber)).links.values()
        from dataclasses import replace

        model = replace(sizing.model, reading=reading, absent=absent)
        best = recommend(model, Goals())
        assert best is not None
        for each in assumptions(model, Goals(), best):
            assert_chinese(each.name)
            assert_chinese(each.alternative)
            assert_chinese(each.in_words())


def test_a_page_is_written_and_replaced_on_request_only(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "sizing.html"
    args = ["size", "--stations", "2", "--mode", "0", "-o", str(target)]
    assert main([*args, "--lang", "zh", "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["links"]["link"]["valid"] is True
    assert err == f"{target}\n"
    found = payload(target)
    assert (found["lang"], len(found["items"])) == ("zh", 1)
    assert "重试次数与超时时间的选择" in target.read_text(encoding="utf-8")
    assert target.stat().st_size < 1_000_000
    assert main(args) == 2
    assert "--force" in capsys.readouterr().err
    assert main([*args, "--force"]) == 0
    assert payload(target)["lang"] == "en"


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (["--standard-lines"], "name it with --out"),
        (["--standard-lines", "--lang", "fr", "-o", "x.html"], "'fr' is not one of 'en', 'zh'"),
        (["two_stations", "--standard-lines", "-o", "x.html"], "SCENARIO and --standard-lines exclude"),
        (["--mode", "2", "--standard-lines", "-o", "x.html"], "--mode and --standard-lines exclude"),
        (["--profile", "pw", "--standard-lines", "-o", "x.html"], "--profile is 'pw'"),
    ],
)
def test_what_does_not_go_together_is_refused(
    args: list[str],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["size", *args]) == 2
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_names_that_look_like_markup_stay_text(tmp_path: Path) -> None:
    path, target = tmp_path / "x.yaml", tmp_path / "x.html"
    path.write_text(
        LINE.replace("name: meters", 'name: "</script><img onerror=1> {name} {0}"'), encoding="utf-8"
    )
    assert main(["size", str(path), "-o", str(target)]) == 0
    assert "<img" not in target.read_text(encoding="utf-8")
    assert payload(target)["name"].startswith("</script>")


def test_the_page_of_the_usual_lines_lies_beside_the_scenarios() -> None:
    path = builtin.folder() / "sizing.html"
    assert path.stat().st_size < 3_000_000
    found = payload(path)
    assert [dim["values"] for dim in found["dims"]] == [[2, 3, 4, 5, 6, 7, 8], [0, 1, 2, 3, 4]]
    assert len(found["items"]) == 35
    for stations, mode in ((2, 0), (4, 2), (8, 4)):
        item = found["items"][(stations - 2) * 5 + mode]
        assert item["about"] == {"stations": stations, "mode": mode}
        (sizing,) = bussim.size(uniform_link(stations, mode)).links.values()
        assert sizing.recommended is not None
        assert item["start"][0] == sizing.recommended.retries
        assert item["units"][item["start"][1]] == sizing.recommended.d8180


@pytest.mark.slow
def test_the_page_of_the_usual_lines_is_what_the_program_makes(tmp_path: Path) -> None:
    target = tmp_path / "sizing.html"
    assert main(["size", "--standard-lines", "-o", str(target)]) == 0
    assert target.read_bytes() == (builtin.folder() / "sizing.html").read_bytes()
