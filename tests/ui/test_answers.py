"""What the page is told equals what the commands print; what is no question is refused in words."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bussim.cli import main
from bussim.scenario import builtin
from tests.ui.asking import EXAMPLE, Page

QUICK = ("two_stations", "bad_parameter")


@pytest.fixture
def page(tmp_path: Path) -> Page:
    return Page(tmp_path)


def opened(page: Page, name: str) -> dict[str, Any]:
    entry = next(each for each in page.ask("list")["entries"] if each["name"] == name)
    found = page.ask("open", id=entry["id"])
    return {"text": found["text"], "name": found["name"], "beside": found["id"]}


def printed(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    capsys.readouterr()
    main([*arguments, "--json"])
    out = capsys.readouterr().out
    found: dict[str, Any] = json.loads(out) if out else {"links": {}}
    return found


def shown_of(sizing: dict[str, Any]) -> dict[str, Any]:
    left_out = ("pareto", "pareto_above_1_s", "margins", "rests_on", "ladder")
    return {key: value for key, value in sizing.items() if key not in left_out}


@pytest.mark.parametrize(
    "name",
    [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in builtin.names()],
)
def test_every_figure_is_that_of_the_commands(
    page: Page, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    line = opened(page, name)
    links = page.ask("check", **line)["form"]["links"]
    exact, size = printed(capsys, "exact", name), printed(capsys, "size", name)
    if not links:
        assert page.ask("law", **line)["figures"] is None
        assert page.ask("size", **line)["sizing"] is None
    for bus in links:
        law = page.ask("law", **line, bus=bus)
        expected = exact["links"][bus]
        for key in ("rests_on", "periods", "refresh_gap_ms"):
            expected.pop(key, None)
        found = law["figures"]
        assert found.pop("refresh_gap_ms") == {}
        assert found == expected
        if law["law"][0]:
            assert len(law["law"][0]) == len(law["law"][1]) <= 1_300
            assert law["law"][0] == sorted(law["law"][0])
        sized = page.ask("size", **line, bus=bus)
        left_out = ("pareto", "pareto_above_1_s", "margins", "rests_on", "ladder")
        assert sized["sizing"] == {
            key: value for key, value in size["links"][bus].items() if key not in left_out
        }
        if sized["rows"] and size["links"][bus]["recommended"]:
            own = {key: value for key, value in sized["rows"][-1].items() if key != "misses"}
            assert own["D8179"] == found["retries"]
            assert own["D8180"] * 10 == found["timeout_ms"]
            best = size["links"][bus]["recommended"]
            setting = {"retries": best["D8179"], "timeout": best["D8180"]}
            if name in ("manual_programs", "setting_programs"):
                assert page.refused("size", **line, bus=bus, form=setting)[1]["key"] == "by_program"
                continue
            there = page.ask("size", **line, bus=bus, form=setting)["rows"][-1]
            assert there == {**best, "misses": []}


def test_where_noise_is_not_known_the_fan_has_its_levels(page: Page) -> None:
    law = page.ask("law", text=EXAMPLE)
    assert [each["level"] for each in law["fan"]] == ["quiet", "typical", "bad"]
    noisy = page.ask("law", text=EXAMPLE, form={"noise": {"kind": "ber", "ber": 1e-5}})
    assert noisy["fan"] == []
    assert noisy["figures"]["mean_ms"] > law["figures"]["mean_ms"]


def test_the_refresh_gaps_are_those_of_exact(page: Page, capsys: pytest.CaptureFixture[str]) -> None:
    found = page.ask("refresh", **opened(page, "two_stations"))["refresh_gap_ms"]
    assert found == printed(capsys, "exact", "two_stations")["links"]["link"]["refresh_gap_ms"]


def test_questions_come_back_with_their_number_and_their_time(page: Page) -> None:
    response = page.client.post("/api/law", json={"text": EXAMPLE, "n": 77})
    assert response.json()["n"] == 77
    assert response.headers["server-timing"].startswith("answer;dur=")


@pytest.mark.parametrize(
    ("form", "field"),
    [
        ({"retries": 11}, "retries"),
        ({"timeout": 1}, "timeout"),
        ({"mode": 7}, "mode"),
        ({"profile": "fx9"}, "profile"),
        ({"scan": 20_000}, "scan"),
        ({"name": ""}, "name"),
    ],
)
def test_a_value_out_of_range_is_said_at_its_field(page: Page, form: dict[str, Any], field: str) -> None:
    status, error = page.refused("law", text=EXAMPLE, form=form)
    assert (status, error["key"]) == (400, "mistakes")
    assert field in [each["field"] for each in error["values"]["problems"]]


def test_a_mistake_of_something_else_is_said_at_no_field(page: Page) -> None:
    port = "  - name: master\n    ports: {COM3: {bus: link, protocol: free, timeout: -1 s}}\n"
    for old, new in (
        ("name: slave1", "name: a;b"),
        ("name: link", "name: a;b"),
        ("  - name: master\n", port),
    ):
        _, error = page.refused("law", text=EXAMPLE.replace(old, new))
        assert {each["field"] for each in error["values"]["problems"]} == {""}


@pytest.mark.parametrize(
    "form", [{"stations": 9}, {"retries": -1}, {"retries": "3"}, {"off": "x"}, {"no": 1}]
)
def test_what_is_no_form_is_refused(page: Page, form: dict[str, Any]) -> None:
    status, error = page.refused("law", text=EXAMPLE, form=form)
    assert (status, error["key"]) == (400, "body")
    assert error["values"]["field"].startswith("form")


@pytest.mark.slow
def test_a_line_that_has_nothing_to_size_is_no_mistake_of_the_goals(page: Page) -> None:
    goals = ["errors<=1/y", "ride>=100ms"]  # as the page begins
    found = page.ask("size", **opened(page, "barcode_reader"), goals=goals)
    assert (found["sizing"], found["ports"]) == (None, {})
    line = opened(page, "unplugged_thermostat")
    assert page.ask("size", **line, goals=goals)["ports"]
    assert page.refused("size", **line, goals=["errors<=-1/y"])[1]["key"] == "goal"


@pytest.mark.slow
def test_goals_are_those_of_size(page: Page, capsys: pytest.CaptureFixture[str]) -> None:
    line = opened(page, "electrical_noise")
    found = page.ask("size", **line, goals=["errors<=1/d", "dead<=200ms", "heartbeat=2s"])
    given_ = [text for goal in ("errors<=1/d", "dead<=200ms", "heartbeat=2s") for text in ("--goal", goal)]
    assert found["sizing"] == shown_of(printed(capsys, "size", "electrical_noise", *given_)["links"]["link"])
    status, error = page.refused("size", **line, goals=["dead<400"])
    assert (status, error["key"]) == (400, "goal")
    assert "dead<=400ms" in error["text"]


def test_mistakes_have_the_places_that_check_names(
    page: Page, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "line.yaml"
    for old, new in (
        ("retries: 3", "retrise: 3"),
        ("mode: 2", "mode: 9"),
        ("schema: 1", "schema:1"),
        ("plcs:", "plcs"),
    ):
        file.write_text(EXAMPLE.replace(old, new), "utf-8")
        capsys.readouterr()
        assert main(["check", str(file)]) == 2
        expected = capsys.readouterr()
        _, error = page.refused("check", text=EXAMPLE.replace(old, new))
        for each in error["values"]["problems"]:
            assert f"{file}:{each['line']}:{each['column']}: {each['message']}" in expected.out + expected.err


JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=10), inner, max_size=4),
    max_leaves=12,
)
FORM = st.fixed_dictionaries(
    {},
    optional={
        "stations": st.integers(-1, 9) | JSON,
        "mode": st.integers(-1, 6) | JSON,
        "retries": st.integers(-1, 12) | JSON,
        "timeout": st.integers(-1, 300) | JSON,
        "scan": st.floats(-1, 1e5) | JSON,
        "scans": st.dictionaries(
            st.sampled_from(["master", "slave1", "none"]), st.fixed_dictionaries({"mean": st.floats(0, 50)})
        ),
        "noise": st.fixed_dictionaries(
            {"kind": st.sampled_from(["unknown", "ber", "burst", "counters"])},
            optional={
                "ber": st.floats(0, 1) | JSON,
                "bad": st.floats(0, 1e4),
                "entries": st.lists(JSON, max_size=2),
            },
        )
        | JSON,
        "off": st.lists(st.sampled_from(["master", "slave1", "slave3", "x"]), max_size=3) | JSON,
        "name": JSON,
        "profile": st.sampled_from(["pw10", "fx1s", "fx3u"]) | JSON,
    },
)
BODY = st.fixed_dictionaries(
    {},
    optional={
        "text": st.just(EXAMPLE) | st.sampled_from([EXAMPLE[:200], EXAMPLE.replace("master", "x"), "[]", "- a", ""]) | JSON,
        "form": FORM | JSON,
        "bus": st.sampled_from(["", "link", "other"]) | JSON,
        "beside": JSON,
        "goals": st.lists(st.sampled_from(["errors<=1/y", "dead<=1s", "nonsense"]) | JSON, max_size=2) | JSON,
        "id": JSON,
        "target": st.sampled_from(["a.yaml", "../a.yaml", "a.txt", "..yaml"]) | JSON,
        "expected": JSON,
        "watched_h": st.floats(0.1, 100) | JSON,
        "master": st.dictionaries(st.sampled_from(["1", "2", "9"]), st.integers(0, 40)) | JSON,
        "slaves": st.dictionaries(st.sampled_from(["1", "3", "9"]), st.integers(0, 40)) | JSON,
        "duration_s": JSON,
        "run": JSON,
    },
)  # fmt: skip
QUESTIONS = (
    "hello",
    "check",
    "edit",
    "law",
    "size",
    "refresh",
    "counters",
    "list",
    "open",
    "save",
    "run/stop",
    "run/said",
    "report",
)


def _never_a_fault(page: Page, question: str, body: Any) -> None:
    kind = {"content-type": "application/json"}
    response = page.client.post(f"/api/{question}", content=json.dumps(body), headers=kind)
    assert response.status_code in (200, 400, 409), response.text
    if response.status_code != 200:
        assert response.json()["error"]["text"]


@given(st.sampled_from(QUESTIONS), BODY | JSON)
def test_no_body_is_a_fault(tmp_path_factory: pytest.TempPathFactory, question: str, body: Any) -> None:
    _never_a_fault(Page(tmp_path_factory.mktemp("page")), question, body)


@pytest.mark.slow
@settings(max_examples=1000)
@given(st.sampled_from(QUESTIONS), BODY)
def test_no_body_of_a_thousand_is_a_fault(
    tmp_path_factory: pytest.TempPathFactory, question: str, body: Any
) -> None:
    _never_a_fault(Page(tmp_path_factory.mktemp("page")), question, body)


@given(st.sampled_from(QUESTIONS), st.binary(max_size=200))
def test_no_bytes_are_a_fault(tmp_path_factory: pytest.TempPathFactory, question: str, raw: bytes) -> None:
    page = Page(tmp_path_factory.mktemp("page"))
    response = page.client.post(f"/api/{question}", content=raw, headers={"content-type": "application/json"})
    assert response.status_code in (200, 400)
