"""Several mistakes at once, and what the command line makes of every one of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from bussim.cli import main
from tests.scenario.rules import test_broken_disturbances, test_broken_plcs
from tests.scenario.samples import BASE, added, mistakes
from tests.scenario.yaml import test_broken_yaml

ALL = {**test_broken_plcs.CASES, **test_broken_disturbances.CASES, **test_broken_yaml.CASES}


@pytest.mark.parametrize(("text", "expected"), ALL.values(), ids=ALL.keys())
def test_check_prints_every_mistake_and_exits_with_2(
    text: str,
    expected: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("x.yaml").write_text(text, encoding="utf-8", newline="")
    assert main(["check", "x.yaml"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.splitlines() == expected


def test_all_mistakes_are_reported_at_once_in_file_order() -> None:
    text = added("noise:\n  - {bus: lnk, ber: 2}\nfaults:\n  - {at: 5, stop: absent}\n")
    text = text.replace("station: 1", "station: 9").replace("schema: 1", "schema: 3")
    assert mistakes(text) == [
        "x.yaml:1:9: schema is 3, allowed 1",
        "x.yaml:10:69: nn.station is 9, allowed 0..7",
        "x.yaml:13:11: bus is 'lnk', which is no bus; did you mean link?",
        "x.yaml:13:21: ber is 2, allowed 0..1",
        "x.yaml:15:10: at is 5, a time without a unit; write one of ns, us, ms, s, min, h, d, y, such as 5 s",
        "x.yaml:15:19: stop is 'absent', which is no PLC; allowed are press1, press2, press3",
    ]


def test_a_wrong_key_hides_no_other_mistake_of_its_plc() -> None:
    text = BASE.replace(
        "scan: 5 ms, nn: {bus: link, port: COM4, station: 2", "scn: 5, nn: {bus: lin, retries: 11"
    )
    assert mistakes(text) == [
        "x.yaml:11:20: scn is not a key here; allowed are name, profile, scan, phase, nn, registers, ports, polls, sources, program, inputs, comments; did you mean scan?",
        "x.yaml:11:32: nn.station is missing",
        "x.yaml:11:38: nn.bus is 'lin', which is no bus; did you mean link?",
        "x.yaml:11:52: nn.retries is 11, allowed 0..10",
    ]
    text = BASE.replace(
        "scan: 5 ms, nn: {bus: link, port: COM4, station: 2", "scn: 5, nn: {bus: lin, station: 2"
    )
    assert mistakes(text) == [
        "x.yaml:11:20: scn is not a key here; allowed are name, profile, scan, phase, nn, registers, ports, polls, sources, program, inputs, comments; did you mean scan?",
        "x.yaml:11:38: nn.bus is 'lin', which is no bus; did you mean link?",
    ]


def test_nothing_is_held_against_a_plc_whose_link_could_not_be_read() -> None:
    faults = "faults:\n  - {drop_reply: press2}\nnoise:\n  - {bus: link, station: press2, ber: 0.1}\n"
    text = added(faults).replace("station: 1", "station: 9")
    assert mistakes(text) == ["x.yaml:10:69: nn.station is 9, allowed 0..7"]


def test_nine_stations() -> None:
    plcs = enumerate((3, 4, 5, 6, 7, 7), start=4)
    more = "".join(f"  - {{name: press{n}, nn: {{bus: link, station: {station}}}}}\n" for n, station in plcs)
    assert mistakes(BASE + more) == [
        "x.yaml:17:5: press9 is one too many: link, an N:N link, takes 8 stations"
    ]


@pytest.mark.parametrize(
    ("good", "bad", "said"),
    [
        ("schema: 1", "schema: 3", "schema is 3, allowed 1"),
        ("schema: 1\n", "", "schema is missing"),
        ("duration: 10 s", "duration: 10", "such as 10 s"),
    ],
)
def test_what_stands_beside_a_wrong_key_at_the_top_is_judged_too(good: str, bad: str, said: str) -> None:
    text = added("observe: [nobody.D1]\n")
    (alone,) = mistakes(text)
    both = mistakes(text.replace(good, bad))
    assert len(both) == 2
    assert said in both[0]
    assert both[1].split(": ", 1)[1] == alone.split(": ", 1)[1]


def test_a_wrong_key_of_what_a_device_says_is_shown_the_right_ones() -> None:
    (said,) = mistakes(
        added('devices:\n  - {name: r, model: free, bus: b, says: [{data: "11 12", at: 500 ms}]}\n').replace(
            "buses:", "buses:\n  - {name: b, baud: 9600, format: 8N1}", 1
        )
    )
    assert said.endswith(
        "says.0.data is not a key here; allowed are text, bytes, at, every, times, jitter, reply_to, delay"
    )
