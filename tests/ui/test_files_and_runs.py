"""Opening and saving in one folder, and simulations that are told, stopped and reported."""

from __future__ import annotations

import os
import signal
import threading
import time
from difflib import unified_diff
from pathlib import Path
from typing import Any

import pytest

from bussim.scenario import builtin
from tests.ui.asking import EXAMPLE, Page


@pytest.fixture
def page(tmp_path: Path) -> Page:
    return Page(tmp_path)


def entry(page: Page, name: str) -> str:
    return next(str(each["id"]) for each in page.ask("list")["entries"] if each["name"] == name)


def differing(old: str, new: str) -> list[str]:
    return [
        line
        for line in unified_diff(old.splitlines(), new.splitlines(), n=0, lineterm="")
        if line[:3] not in ("---", "+++") and line[0] in "+-"
    ]


def test_saving_changes_only_the_lines_whose_values_were_moved(page: Page, tmp_path: Path) -> None:
    text = builtin.read("electrical_noise").replace("\n", "\r\n")
    (tmp_path / "line.yaml").write_bytes(text.encode())
    opened = page.ask("open", id=entry(page, "line.yaml"))
    assert opened["text"] == text
    form = {"retries": 5, "noise": {"kind": "counters", "entries": []}, "off": ["hoist"], "stations": 5}
    saved = page.ask("save", text=text, form=form, target="line.yaml", expected=opened["hash"])
    new = (tmp_path / "line.yaml").read_bytes().decode()
    assert saved["text"] == new
    assert set(differing(text, new)) == {
        "-    nn: {bus: link, port: COM3, station: 0, slaves: 3, mode: 2, retries: 3, timeout: 50 ms}",
        "+    nn: {bus: link, port: COM3, station: 0, slaves: 4, mode: 2, retries: 5, timeout: 50 ms}",
        "+  - {name: slave4, scan: {mean: 5 ms, jitter: 1 ms}, nn: {bus: link, port: COM3, station: 4}}",
        "-  - {name: cable, bus: link, ber: 2.0e-5}",
        "-  - {name: loose_shield, bus: link, station: grab, direction: rx, ber: 1.0e-5}   # only what grab hears",
        "-noise:",
        "+noise:",
        "+  []   # only what grab hears",
        "+faults: [{power_off: hoist}]",
    } - {"-noise:", "+noise:"}
    again = page.ask("check", text=new)["form"]
    assert (again["retries"], again["stations"], again["off"], again["noise"]) == (
        5,
        5,
        ["hoist"],
        {"kind": "unknown"},
    )
    back = page.ask("edit", text=new, form={"off": [], "stations": 4, "retries": 3})["text"]
    assert "slave4" not in back
    assert "power_off" not in back


def test_a_file_that_was_changed_elsewhere_is_not_overwritten(page: Page, tmp_path: Path) -> None:
    first = page.ask("save", text=EXAMPLE, target="a.yaml", expected=None)
    assert page.refused("save", text=EXAMPLE, target="a.yaml", expected=None)[0] == 409
    (tmp_path / "a.yaml").write_text("schema: 1\n", "utf-8")
    status, error = page.refused("save", text=EXAMPLE, target="a.yaml", expected=first["hash"])
    assert (status, error["key"]) == (409, "conflict")
    assert (tmp_path / "a.yaml").read_text("utf-8") == "schema: 1\n"
    (tmp_path / "a.yaml").unlink()
    assert page.refused("save", text=EXAMPLE, target="a.yaml", expected=first["hash"])[0] == 409


@pytest.mark.parametrize("name", ["../a.yaml", "/a.yaml", "a.txt", ".yaml", "b/a.yaml", "a\\b.yaml", "a.yaml\n", "", "a\0.yaml", "C:a.yaml"])  # fmt: skip
def test_only_plain_names_of_yaml_are_written(page: Page, tmp_path: Path, name: str) -> None:
    status, error = page.refused("save", text=EXAMPLE, target=name, expected=None)
    assert (status, error["key"]) == (400, "name")
    assert not [*tmp_path.iterdir()]


def test_links_lead_neither_out_nor_in(page: Page, tmp_path: Path) -> None:
    outside = tmp_path.parent / f"{tmp_path.name}-outside.yaml"
    outside.write_text(EXAMPLE, "utf-8")
    (tmp_path / "link.yaml").symlink_to(outside)
    assert "link.yaml" not in [each["name"] for each in page.ask("list")["entries"]]
    assert page.refused("save", text=EXAMPLE, target="link.yaml", expected=None)[0] in (400, 409)
    assert page.refused("open", id="999")[1]["key"] == "unknown_id"
    assert outside.read_text("utf-8") == EXAMPLE


def run(page: Page, **more: Any) -> list[dict[str, Any]]:
    return page.lines("run", text=EXAMPLE, **more)


@pytest.mark.slow
def test_a_simulation_tells_its_progress_and_what_came_out(page: Page, tmp_path: Path) -> None:
    events = run(page, duration_s=5, form={"retries": 4}, seed=3)
    assert [each["event"] for each in events if each["event"] != "progress"] == ["started", "finished"]
    found = events[-1]
    assert Path(found["folder"]).parent == tmp_path / "runs"
    text = (Path(found["folder"]) / "scenario.yaml").read_text("utf-8")
    assert "retries: 4" in text
    assert "seed: 3" in text
    assert found["histograms"]["link"]["law"]
    assert found["worst"]["link"]["boxes"]
    assert found["links"]["link"]["scan_time_ms"]["mean"] == pytest.approx(found["means"]["link"], abs=0.2)
    url = page.ask("report", text=EXAMPLE, run=found["id"])["url"]
    report = page.client.get(url)
    assert "<h1>" in report.text
    assert "sha256-" in report.text
    assert page.client.get(url).text == report.text  # loaded anew
    for _ in range(8):  # of these so many are kept
        page.ask("report", text=EXAMPLE)
    assert page.client.get(url).status_code == 404


@pytest.mark.slow
def test_a_stopped_simulation_ends_and_leaves_its_folder_incomplete(page: Page, tmp_path: Path) -> None:
    events: list[dict[str, Any]] = []
    thread = threading.Thread(target=lambda: events.extend(run(page, duration_s=100_000, trace=False)))
    thread.start()
    service = page.service
    while not service.running:
        time.sleep(0.02)
    (key,) = service.running
    while not [*tmp_path.glob("runs/*.incomplete")]:
        time.sleep(0.02)
    assert page.refused("run", text=EXAMPLE)[0] == 429
    process = service.running[key]._process
    page.ask("run/stop", id=key)
    thread.join(20)
    assert not thread.is_alive()
    assert events[-1]["event"] == "stopped"
    assert process.exitcode is not None
    assert [each.name for each in (tmp_path / "runs").iterdir() if each.is_dir()] == ["ui.incomplete"]
    assert page.refused("run/stop", id=key)[1]["key"] == "unknown_id"
    assert run(page, duration_s=1, trace=False)[-1]["event"] == "finished"


@pytest.mark.slow
def test_a_simulation_whose_process_dies_has_failed(page: Page) -> None:
    events: list[dict[str, Any]] = []
    thread = threading.Thread(target=lambda: events.extend(run(page, duration_s=100_000, trace=False)))
    thread.start()
    while not page.service.running:
        time.sleep(0.02)
    (running,) = page.service.running.values()
    os.kill(running._process.pid, signal.SIGKILL)
    thread.join(20)
    assert events[-1]["event"] == "failed"
    assert not page.service.running


@pytest.mark.slow
@pytest.mark.parametrize("lang", ["en", "zh"])
def test_the_printed_page_is_that_of_size(page: Page, lang: str) -> None:
    url = page.ask("report", text=EXAMPLE, lang=lang, goals=["errors<=2/y"])["url"]
    text = page.client.get(url).text
    assert f'<html lang="{"en" if lang == "en" else "zh-Hans"}">' in text
    assert "false station errors: at most 2 a year" in text


@pytest.mark.slow
def test_counters_read_on_site_become_noise(page: Page) -> None:
    found = page.ask(
        "counters",
        text=EXAMPLE,
        watched_h=1,
        slaves={"1": 500, "2": 505, "3": 498},
        master={"1": 0, "2": 0, "3": 0},
    )
    (wire,) = [each for each in found["noise_upper_limits"] if each.keys() == {"bus", "ber"}]
    assert 1e-6 < wire["ber"] < 1e-4
    form = {"noise": {"kind": "counters", "entries": found["noise_upper_limits"]}}
    assert page.ask("law", text=EXAMPLE, form=form)["fan"] == []
    assert page.refused("counters", text=EXAMPLE, watched_h=1)[1]["key"] == "no_counts"
    zero = page.ask("counters", text=EXAMPLE, watched_h=24, slaves={"1": 0, "2": 0, "3": 0})
    assert zero["noise_upper_limits"]


def test_quit_ends_the_server(page: Page) -> None:
    page.ask("quit")
    assert page.ended


def test_the_file_that_was_opened_is_saved_whatever_way_leads_to_it(tmp_path: Path) -> None:
    (tmp_path / "below").mkdir()
    (tmp_path / "line.yaml").write_text(EXAMPLE, "utf-8")
    (tmp_path / "way").symlink_to(tmp_path)
    for way in ("below/..", "way"):
        page = Page(tmp_path / way, tmp_path / way / "line.yaml")
        opened = page.ask("hello")["opened"]
        assert page.ask("save", text=EXAMPLE, target="line.yaml", expected=opened["hash"])


@pytest.mark.parametrize("raw", [None, EXAMPLE.replace("mode 2", "压机").encode("gbk")])
def test_a_page_whose_file_cannot_be_read_begins_with_the_example_and_says_so(
    tmp_path: Path, raw: bytes | None
) -> None:
    file = tmp_path / "line.yaml"
    if raw is not None:
        file.write_bytes(raw)
    said = Page(tmp_path, file).ask("hello")
    assert said["opened"]["text"] == EXAMPLE
    assert (said["bad"]["key"], said["bad"]["values"]) == ("unreadable", {"name": "line.yaml"})
    assert Page(tmp_path).ask("hello")["bad"] is None


def test_what_is_wrong_with_the_folder_is_no_fault_of_bussim(page: Page, tmp_path: Path) -> None:
    (tmp_path / "folder.yaml").mkdir()
    for name in ("folder.yaml", "线" * 95 + ".yaml"):  # more than 255 bytes
        assert page.refused("save", text=EXAMPLE, target=name)[0] == 400
    (tmp_path / "folder.yaml").rmdir()
    tmp_path.rmdir()
    assert page.ask("hello")["opened"]["text"] == EXAMPLE
    assert page.ask("law", text=EXAMPLE)["figures"]
    assert page.refused("list")[1]["key"] == "refused"
    assert page.refused("save", text=EXAMPLE, target="a.yaml")[1]["key"] == "unwritable"


#: A line whose master takes its refresh mode from a program in a file.
PROGRAM = EXAMPLE.replace("  - name: master\n", "  - name: master\n    program: {file: own.il}\n")


def test_a_recommendation_is_of_the_program_as_it_is_now(page: Page, tmp_path: Path) -> None:
    found = []
    for mode in (1, 0):
        (tmp_path / "own.il").write_text(f"LD M8002\nMOV K{mode} D8178\nEND\n", "utf-8")
        found.append(page.ask("size", text=PROGRAM)["sizing"]["recommended"])
    assert found[1] == Page(tmp_path).ask("size", text=PROGRAM)["sizing"]["recommended"]
    assert found[0] != found[1]


def test_a_file_of_the_line_is_found_among_however_many(page: Page, tmp_path: Path) -> None:
    for number in range(600):
        (tmp_path / f"{number}.il").touch()
    *_, last = tmp_path.iterdir()  # as the file system has them
    last.write_text("LD M8002\nMOV K1 D8178\nEND\n", "utf-8")
    assert page.ask("check", text=PROGRAM.replace("own.il", last.name))["form"]["mode"] == 1


@pytest.mark.slow
def test_what_a_run_says_is_told_again_in_the_other_language(page: Page) -> None:
    done = run(page, duration_s=2, seed=1)[-1]
    again = page.ask("run/said", id=done["id"], lang="zh")
    assert again["histograms"]["link"]["law"] == done["histograms"]["link"]["law"]
    assert again["verdict"] != done["verdict"]
    assert "链接扫描" in again["verdict"][0]
    assert page.ask("run/said", id=done["id"], lang="en") == done
    assert page.refused("run/said", id="x", lang="en")[1]["key"] == "unknown_id"
