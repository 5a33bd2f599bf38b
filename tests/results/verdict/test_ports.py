"""What became of requests and messages, against counts reckoned from frames and receptions of the trace."""

from __future__ import annotations

import json
import random
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

import bussim
from bussim.results.verdict.verdict import faults

from .cases import Case, Data
from .port_cases import PORT_CASES, modbus, readers
from .test_verdict import SYMPTOMS, items, run

TICKS = 72_000_000


def traced(scenario: Data, folder: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    path = folder / "scenario.yaml"
    path.write_text(yaml.safe_dump(scenario), encoding="utf-8")
    result = bussim.run(path, out=folder / "out", trace=True)
    lines = (folder / "out" / "trace.jsonl").read_text(encoding="utf-8").splitlines()
    return result.summary, [json.loads(line) for line in lines]


def became(trace: list[dict[str, Any]]) -> Counter[str]:
    """What became of reader1's codes at COM3: whole ones are the characters but the CR, ended by that."""
    receptions = [
        line
        for line in trace
        if line["type"] == "free" and (line["node"], line["direction"]) == ("sorter.COM3", "received")
    ]
    found: Counter[str] = Counter()
    for frame in trace:
        if frame["type"] != "frame" or frame["sender"] != "reader1" or frame["cut"]:
            continue
        mine = [each for each in receptions if each["start"] < frame["end"] and frame["tick"] < each["end"]]
        flagged = any(each["damaged"] or each["ended"] == "timeout" for each in mine)
        taken = b"".join(bytes.fromhex(each["data"]) + b"\r" for each in mine)
        if not mine:
            found["damaged" if frame["damaged_bits"] else "lost"] += 1
        elif flagged:
            found["damaged"] += 1
        else:
            found["whole" if taken == b"4006381333931\r" else "wrong"] += 1
    return found


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("fault", "noise"),
    [
        ({"cable_cut": {"bus": "belt", "after": "sorter.COM3"}}, None),
        ({"lose_char": {"station": "reader1"}}, None),
        ({"insert_char": {"station": "reader1"}}, None),
        (None, 1e-2),
        (None, 1e-3),
        (None, None),
    ],
    ids=["cut", "lost character", "added character", "noise", "little noise", "nothing"],
)
def test_messages_add_up_and_are_what_the_trace_shows(
    seed: int, fault: Data | None, noise: float | None, tmp_path: Path
) -> None:
    line = readers(random.Random(seed))
    if fault is not None:
        line["faults"] = [{"at": "8 s", "for": "9 s", **fault}]
    if noise is not None:
        line["noise"] = [{"bus": "belt", "ber": noise}]
    summary, trace = traced(line, tmp_path)
    counts = dict(summary["ports"]["sorter.COM3"]["messages"])
    truth = became(trace)
    assert counts.pop("sent") == truth.total()
    assert {word: number for word, number in counts.items() if number} == dict(truth)
    assert summary["buses"]["belt"]["undetected_frames"] == truth["wrong"]
    wrong = {item["key"] for item in faults(summary["verdict"])}
    keys = {"damaged": "message_damaged", "wrong": "message_wrong", "lost": "message_deaf"}
    assert {key for key in keys.values() if key in wrong} == {keys[each] for each in truth if each != "whole"}


@pytest.mark.parametrize("make", PORT_CASES, ids=lambda make: str(make.__name__))
@pytest.mark.parametrize("seed", range(100, 104))
def test_the_cause_is_named_whatever_the_draw(
    make: Callable[[random.Random], Case], seed: int, tmp_path: Path
) -> None:
    case = make(random.Random(seed))
    wrong = faults(items(run(case.scenario, tmp_path)))
    named = [
        item for item in wrong if item["key"] == case.key and case.values.items() <= item["values"].items()
    ]
    assert len(named) == 1, [item["text"] for item in wrong]
    assert {item["key"] for item in wrong} - SYMPTOMS - case.others == {case.key}
    (fault,) = case.scenario.get("faults", [None])
    if fault is not None:
        at, lasts = (float(fault[key].split()[0]) for key in ("at", "for"))
        when = named[0]["values"]["when"]
        # Told by requests or messages that begin at most 1.1 s apart; one may be under way.
        assert at - 0.1 <= when["from_s"] <= at + 1.1
        assert when["from_s"] + when["for_s"] == pytest.approx(at + lasts, abs=1.1)


@pytest.mark.parametrize("seed", range(3))
def test_as_many_requests_are_given_a_cause_as_failed_in_its_times(seed: int, tmp_path: Path) -> None:
    """Under noise requests and replies fail by turns."""
    bus = modbus(random.Random(seed))
    bus["buses"][0]["baud"] = 19200
    impulses = {"every": "20 ms", "width": "300 us", "ber": 0.5}
    bus["noise"] = [{"bus": "drives", "impulse": impulses, "at": "3 s", "for": "5 s"}]
    summary, trace = traced(bus, tmp_path)
    failed = [line["sent"] / TICKS for line in trace if line["type"] == "transaction" and line["error"]]
    told = [item["values"] for item in faults(summary["verdict"]) if item["key"].startswith("request_")]
    assert {item["node"] for item in told} == {"press.COM3"}
    for item in told:
        when = item["when"]
        assert when["times"] <= item["requests"]
        within = [tick for tick in failed if when["first_s"] - 1e-6 <= tick <= when["last_s"]]
        assert item["requests"] <= len(within)
        assert when["times"] > 1 or when["first_s"] == when["from_s"]
        assert (
            2.9 < when["first_s"] <= when["from_s"] < when["from_s"] + when["for_s"] <= when["last_s"] + 1e-6
        )
        assert when["last_s"] < 9
    # What failed in another way than most around it has no cause, and is counted.
    rest = [item["values"] for item in summary["verdict"] if item["key"] == "request_unknown"]
    assert sum(item["requests"] for item in (*told, *rest)) == len(failed)


@pytest.mark.parametrize("interval", ["5 ms", "300 ms"], ids=["mistaken", "late"])
def test_wrong_late_and_exception_responses_have_their_times(interval: str, tmp_path: Path) -> None:
    """A drive that is slow for four seconds, and lacks the registers of a poll from first to last."""
    bus = modbus(random.Random(5), timeout="40 ms", interval=interval)
    bus["plcs"][0]["polls"].append({**bus["plcs"][0]["polls"][0], "name": "wrong", "address": 0x1000})
    bus["faults"] = [{"at": "3 s", "for": "4 s", "slow": {"station": "drive", "extra": "60 ms"}}]
    summary, trace = traced(bus, tmp_path)
    said = {item["key"]: item["values"] for item in faults(summary["verdict"])}
    made = [line for line in trace if line["type"] == "transaction"]
    ticks = {
        "exceptions": [each["end"] for each in made if each["exception"]],
        "mistaken": [
            each["end"] for each in made if each["mismatched"] and (each["exception"] or not each["error"])
        ],
        "late": [each["end"] for each in made if each["sent"] / TICKS > 3 and each["error"] == 9],
    }
    assert bool(ticks["mistaken"]) == (interval == "5 ms") == ("mistaken" in said)
    for key, at in ticks.items():
        if at:
            when = said[key]["when"]
            precision = 1e-6 if key != "late" else 0.1  # known a reply later
            assert when["first_s"] == pytest.approx(at[0] / TICKS, abs=precision)
            assert when["last_s"] == pytest.approx(at[-1] / TICKS, abs=precision)


@pytest.mark.parametrize("delay", [16_500, 17_500, 30_500])
def test_a_reply_under_way_when_the_timeout_is_over_is_late(delay: int, tmp_path: Path) -> None:
    """A reply of 13.5 ms that begins before the timeout of 30 ms, or after it, and ends after it."""
    bus = modbus(random.Random(0))
    bus["buses"][0]["baud"] = 9600
    bus["devices"][0]["delay"] = f"{delay} us"
    polls = [{"station": 1, "function": 3, "address": 0, "count": 4, "every": "200 ms"}]
    panel = {"name": "panel", "model": "hmi", "bus": "drives", "timeout": "30 ms", "polls": polls}
    bus = {**bus, "duration": "3 s", "plcs": [], "devices": [*bus["devices"], panel]}
    result = run(bus, tmp_path)
    assert result.summary["devices"]["panel"]["late_responses"] == 15
    assert {item["key"] for item in faults(items(result))} == {"no_own_data", "late", "request_silent"}


def test_exceptions_far_apart_are_not_said_to_last(tmp_path: Path) -> None:
    bus = modbus(random.Random(1)) | {"duration": "9 s"}
    bus["plcs"][0]["polls"][1] |= {"address": 0x1000, "every": "4 s"}
    (said,) = [item for item in faults(items(run(bus, tmp_path))) if item["key"] == "exceptions"]
    when = said["values"]["when"]
    assert (when["times"], when["total_s"]) == (3, 0)
    between = f"3 times between {when['first_s']:.3f} s and {when['last_s']:.3f} s: 02 3× (illegal address)."
    assert said["text"] == f"press.COM3: exception responses, {between}"


def test_broadcasts_alone_want_no_response(tmp_path: Path) -> None:
    bus = modbus(random.Random(2))
    bus["plcs"][0]["polls"] = [
        {"port": "COM3", "station": 0, "function": 6, "address": 0, "from": "D400", "every": "200 ms"}
    ]
    result = run(bus, tmp_path)
    assert faults(items(result)) == []
    (said,) = [item for item in items(result) if item["key"] == "broadcasts"]
    port = result.summary["ports"]["press.COM3"]
    assert said["values"]["requests"] == port["broadcast_requests"] == port["transactions"] > 40


def test_oldest_data_are_one_figure(tmp_path: Path) -> None:
    """A device that dies for good leaves its data ageing to the end."""
    bus = modbus(random.Random(2))
    bus["faults"] = [{"at": "4 s", "power_off": "drive"}]
    age = run(bus, tmp_path).summary["ports"]["press.COM3"]["polls"]["vfd_speed"]["age_ms"]
    assert age["oldest"] == age["open"] == pytest.approx(6000, abs=150)
    assert age["before_refresh"]["max"] < 1000
