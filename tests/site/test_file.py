"""Reading a readout: what is right, and every mistake with its position, all at once."""

import re
from pathlib import Path

import pytest

from bussim.errors import ScenarioError, UsageError
from bussim.site.file import load
from bussim.site.link import SiteLink
from bussim.site.noise.lenses import measure
from bussim.site.readout import Readout
from tests.site.examples import healthy, readout, seen

HEAD = """schema: 1
kind: readout
profile: {profile}
settings: {{slaves: 1, mode: 0, retries: 3, timeout: 50 ms}}
watched: 2 h
stations:
"""


def problems(text: str, folder: Path) -> list[str]:
    path = folder / "readout.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ScenarioError) as failure:
        load(path)
    return [str(problem).removeprefix(f"{path}:") for problem in failure.value.problems]


def test_what_was_not_read_is_not_zero(tmp_path: Path) -> None:
    data = healthy()
    del data["stations"][2]["after"]["D8204"]
    station = readout(data, tmp_path).at(2)
    assert station is not None
    assert station.count(1) is None
    assert station.count(3) == 0


def test_counts_are_differences_and_what_only_climbs_is_one_at_least(tmp_path: Path) -> None:
    data = healthy()
    for station in data["stations"]:
        station["before"] = dict(station["after"])
    seen(data, 1, D8203=7)
    data["stations"][1]["before"]["D8203"] = 5
    del data["stations"][2]["after"]["D8203"]
    data["stations"][2]["rising"] = ["D8203"]
    found = readout(data, tmp_path)
    assert [found.at(number).count(0) for number in (1, 2, 3)] == [2, 1, 0]  # type: ignore[union-attr]


@pytest.mark.parametrize(("shown", "stored"), [(21, 0x21), (33, 0x21), (31, 0x31), (20, 0x14), (4, 4)])
def test_codes_are_read_in_decimal_and_as_hexadecimal_digits(shown: int, stored: int, tmp_path: Path) -> None:
    data = healthy()
    seen(data, 1, D8213=shown)
    assert readout(data, tmp_path).at(1).code(2) == stored  # type: ignore[union-attr]


def test_a_station_has_one_style_of_codes(tmp_path: Path) -> None:
    data = healthy()
    seen(data, 1, D8211=14, D8213=33, D8214=21)
    with pytest.raises(ScenarioError, match=r"D8213 is 33, no error code; .* are as hexadecimal digits"):
        readout(data, tmp_path)


def test_an_fx1s_has_its_own_names(tmp_path: Path) -> None:
    path = tmp_path / "readout.yaml"
    path.write_text(
        HEAD.format(profile="fx1s")
        + "  - {place: a, after: {D201: 20, D204: 3, D212: 1, M505: on, M503: on}}\n",
        encoding="utf-8",
    )
    found = load(path)
    assert isinstance(found, Readout)
    assert dict(found.stations[0].after.values) == {
        "D8201": 20,
        "D8204": 3,
        "D8212": 1,
        "M8184": 1,
        "M8191": 1,
    }


def test_every_mistake_is_named_with_its_position(tmp_path: Path) -> None:
    found = problems(
        HEAD.format(profile="pw10")
        + """  - place: a
    before: {D8203: 5}
    after: {D8201: [18, 40], D8202: 20, D8203: 3, D8299: 1}
  - {place: a, after: {D8204: 40000, D8211: 77, M8183: maybe}}
ladder: {thresholds_ms: [30, 20], rises: [5, 9]}
""",
        tmp_path,
    )
    positions = "9:37 9:48 9:51 10:5 10:13 10:31 10:45 10:56 11:30"
    assert [problem.partition(": ")[0] for problem in found] == positions.split()
    said = "\n".join(found)
    for text in (
        "after.D8202 is 20, below a look at D8201 (40)", "after.D8203 is 3, below the 5 of before", "did you mean D8209?",
        "has no before, which a has", "place is 'a', as of another station", "after.D8204 is 40000, allowed 0..32767",
        "after.D8211 is 77, no error code; allowed 0, 1, 2, 3, 4, 11, 14", "after.M8183 is 'maybe', allowed on, off",
        "is 20, not above the 30 before it",
    ):  # fmt: skip
        assert text in said


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("watched: 2 h", "watched: 0 h", "watched is 0 h, allowed more than 0"),
        ("50 ms", "55 ms", "timeout is 55 ms, which D8180 (x 10 ms) cannot be; nearest are 50 ms and 60 ms"),
        ("profile: pw10", "profile: pw1", "profile is 'pw1', neither a profile nor a file of one; did you mean pw10?"),
        ("kind: readout", "kind: reading", "kind is 'reading', allowed readout, calibration"),
        ("mode: 0", "mode: 9", "settings.mode is 9, allowed 0..4"),
        ("watched: 2 h", "watched: 2 h\nstarted: 5 min", "started is no such text as: 300 s before the first reading"),
    ],
)  # fmt: skip
def test_what_is_wrong_at_the_top(old: str, new: str, message: str, tmp_path: Path) -> None:
    text = HEAD.format(profile="pw10") + "  - {place: a, after: {D8201: 18}}\n"
    assert message in "\n".join(problems(text.replace(old, new), tmp_path))


def test_a_ladder_must_fit_the_scans(tmp_path: Path) -> None:
    data = healthy() | {"watched": "60 s", "ladder": {"thresholds_ms": [60, 101], "rises": [2000, 3]}}
    with pytest.raises(ScenarioError) as failure:
        readout(data, tmp_path)
    assert [problem.message for problem in failure.value.problems] == [
        "ladder.thresholds_ms.0 is 60, not above the healthy scan of 66.6",
        "ladder.rises.0 is 2000, more than the 901 scans that were watched",
    ]


def test_a_counter_that_has_stopped_is_a_lower_bound_and_no_lens(tmp_path: Path) -> None:
    data = healthy()
    seen(data, 1, D8203=32767, D8211=14)
    paper = readout(data, tmp_path)
    assert "feeder: D8203 is 32767, where counters stop: it is a lower bound" in paper.notes
    assert [lens.station for lens in measure(paper, SiteLink.of(paper)).named("S")] == [2, 3]


def test_a_station_that_tells_of_itself_is_noted(tmp_path: Path) -> None:
    data = healthy()
    seen(data, 2, D8205=7, D8214=31)
    assert "lift (station 2) counts about itself (D8205 = 7)" in " ".join(readout(data, tmp_path).notes)


def test_unread_numbers_are_those_that_fit(tmp_path: Path) -> None:
    """The paper has feeder before lift, and lift counts about 2: it is station 1."""
    data = healthy()
    for station in data["stations"]:
        del station["number"]
    seen(data, 1, D8204=90)
    seen(data, 2, D8205=80)
    assert [station.supposed for station in readout(data, tmp_path).stations] == [0, 2, 1, 3]


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        load(tmp_path / "none.yaml")
    (tmp_path / "empty.yaml").write_text("", encoding="utf-8")
    with pytest.raises(ScenarioError, match="is empty; a readout begins with schema: 1, kind: readout"):
        load(tmp_path / "empty.yaml")


def test_a_profile_whose_name_no_file_can_have_is_told(tmp_path: Path) -> None:
    found = problems(HEAD.format(profile="x" * 300) + "  - {place: press}\n", tmp_path)
    assert any("neither a profile nor a file of one" in problem for problem in found)


@pytest.mark.parametrize(
    ("ladder", "message"),
    [
        ({"rises": [0, 7, 0]}, "ladder.rises.1 is 7, and D8201 never rose to 70"),
        ({"rises": [9, 7, 0], "max_ms": 66}, "ladder.max_ms is 66, with 9 rises to 70"),
        ({"rises": [9, 7, 0], "max_ms": 140}, "ladder.max_ms is 140, with 0 rises to 125"),
        ({"rises": [9, 19000, 0]}, "ladder.rises.1 is 19000, more than the 18018 scans that were watched"),
    ],
)
def test_a_ladder_does_not_contradict_itself(ladder: dict[str, object], message: str, tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=message):
        readout(healthy() | {"ladder": {"thresholds_ms": [70, 101, 125], **ladder}}, tmp_path)


@pytest.mark.parametrize(
    ("number", "name", "count"), [(0, "D8205", 20000), (1, "D8203", 300000 // 10), (3, "D8204", 19000)]
)
def test_no_more_is_counted_than_there_were_scans(number: int, name: str, count: int, tmp_path: Path) -> None:
    """Of a slave that may have run before the master's last start it is noted: give before."""
    data = healthy() | {"watched": "20 min" if name != "D8203" else "2 min"}
    seen(data, number, **{name: count})
    said = rf"{name} counts {count} while it was watched, which is \d+ scans"
    if number:
        assert re.search(f"{said}: it counts from before", " ".join(readout(data, tmp_path).notes))
        for station in data["stations"]:
            station["before"] = {**station["after"], name: 0}
    with pytest.raises(ScenarioError, match=said):
        readout(data, tmp_path)


def test_a_register_is_noted_once(tmp_path: Path) -> None:
    data = healthy()
    seen(data, 1, d8203=4)
    with pytest.raises(ScenarioError, match="d8203 is the register D8203 once more"):
        readout(data, tmp_path)
