"""The text on the page: typed while sliders move, saved as its file is, and read in the coding that it has."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.ui.asking import EXAMPLE
from tests.ui.window import IN_A_BROWSER, Seen, event, opened, server

pytestmark = IN_A_BROWSER


@pytest.fixture
def seen(window: Any, tmp_path: Path) -> Iterator[Seen]:
    (tmp_path / "line.yaml").write_bytes(b"\xef\xbb\xbf" + EXAMPLE.replace("\n", "\r\n").encode())
    with server(tmp_path, str(tmp_path / "line.yaml"), "--lang", "en") as (_, address):
        found = Seen(window, address)
        found.load()
        found.js("document.getElementById('yaml-part').open = true")
        yield found


def area(seen: Seen) -> str:
    return str(seen.one("#yaml").get_attribute("value"))


def save(seen: Seen) -> None:
    seen.click("#save")
    seen.click("#save-now")
    seen.until(lambda: seen.text("#file") == "saved")


def test_the_text_follows_the_sliders_and_loses_nothing_that_is_typed(seen: Seen, tmp_path: Path) -> None:
    seen.put("#retries", 6)
    seen.until(lambda: "retries: 6 " in area(seen))
    seen.put("#yaml", area(seen).replace("seed: 1 ", "seed: 77 "))
    assert seen.text("#file") == "changed, not saved"
    seen.put("#timeout", 7)
    seen.settle()
    seen.load(fresh=False)  # also of what is typed
    assert "seed: 77 " in area(seen)
    save(seen)
    raw = (tmp_path / "line.yaml").read_bytes()
    wanted = EXAMPLE.replace("seed: 1 ", "seed: 77 ").replace("retries: 3", "retries: 6")
    wanted = wanted.replace("timeout: 100 ms", "timeout: 70 ms")
    assert raw == b"\xef\xbb\xbf" + wanted.replace("\n", "\r\n").encode()  # with the line ends that it had
    seen.click("#undo")
    seen.settle()
    assert "seed: 77 " not in area(seen)


def test_a_file_that_is_no_utf_8_is_not_taken_with_other_letters(seen: Seen, tmp_path: Path) -> None:
    file = tmp_path / "gbk.yaml"
    file.write_bytes(EXAMPLE.replace("mode 2", "压机").encode("gbk"))
    seen.click("#open")
    seen.one("#chosen-file").send_keys(str(file))
    seen.until(lambda: "gbk.yaml cannot be read" in seen.text("#open-bad"))
    assert seen.line()["text"].startswith("\ufeff# 4 PLCs")


def test_a_page_outlives_its_file(seen: Seen, tmp_path: Path) -> None:
    seen.put("#retries", 8)
    seen.settle()
    (tmp_path / "line.yaml").unlink()
    seen.load(fresh=False)
    assert seen.line()["form"] == {"retries": 8}
    assert seen.one("#tiles").is_displayed()
    seen.js("sessionStorage.clear()")
    seen.load(fresh=False)
    seen.until(lambda: "line.yaml cannot be read" in seen.text("#open-bad"))
    assert "This is an example" in seen.text("#hint")
    seen.put("#yaml", area(seen) + "# typed")
    seen.js("window.confirm = (text) => { window.asked = text; return true; }")
    opened(seen, "press_line")
    assert "not saved are lost" in seen.js("return window.asked ?? ''")
    seen.until(lambda: "three presses" in str(seen.one("#name").get_attribute("value")))


def test_a_second_run_and_another_language_leave_one_row_of_buttons_and_no_english(seen: Seen) -> None:
    buttons = "return [...document.querySelectorAll('#histogram .tools button')].map(e => e.textContent)"
    seen.put("#duration", 2)
    for _ in range(2):
        seen.js("document.getElementById('run-said').dataset.event = ''")
        seen.click("#run")
        seen.until(lambda: event(seen) == "finished")
    assert len(seen.js(buttons)) == len(set(seen.js(buttons)))
    seen.put("#duration", 1_000_000)
    seen.click("#run")
    seen.until(lambda: event(seen) == "progress")
    seen.click("#stop")
    seen.until(lambda: event(seen) == "stopped")
    seen.click("button[data-lang=zh]")
    seen.until(lambda: "扫描" in seen.text("#run-verdict"))
    assert event(seen) == "stopped"  # the last one that was finished is told anew, but this one was stopped
    assert "放大" in seen.js(buttons)
    assert "Zoom in" not in seen.js(buttons)
    for part in ("#run-verdict", "#histogram .legend", "#worst .legend"):
        assert "link scan" not in seen.text(part)
        assert "frame" not in seen.text(part)


def test_an_empty_box_of_a_goal_shows_what_it_stands_for(seen: Seen) -> None:
    seen.put("#goal-errors", "")
    seen.put("#goal-ride", "")
    seen.settle()
    assert "at most 1 a year" in seen.text("#verdict")
    found = seen.js("return [...document.querySelectorAll('#goals-part input')].map(e => e.placeholder)")
    assert found == ["1", "100", "", ""]


def test_scans_of_single_stations_are_taken_back(seen: Seen) -> None:
    seen.put("[data-scan=slave1][data-part=mean]", "12.5")
    seen.settle()
    assert seen.line()["form"] == {"scans": {"slave1": {"mean": 12.5, "jitter": 0}}}
    assert seen.one("[data-reset=scan]").is_displayed()
    seen.click("[data-reset=scan]")
    seen.settle()
    assert seen.line()["form"] == {}


def test_a_line_without_a_link_shows_nothing_of_the_last_one(seen: Seen) -> None:
    opened(seen, "barcode_reader")
    seen.until(lambda: "no N:N link" in seen.text("#also"))
    seen.settle()
    for part in ("#tiles", "#verdict", "#recommended", "#trade", "#costs", "#assumed", "#curve", "#gaps"):
        assert not seen.one(part).is_displayed()


def test_what_a_page_keeps_when_bussim_is_gone_is_named(window: Any, tmp_path: Path) -> None:
    with server(tmp_path, "--lang", "en") as (process, address):
        seen = Seen(window, address)
        seen.load()
        process.terminate()
        process.wait(20)
        seen.put("#retries", 9)
        seen.put("#timeout", 7)
        seen.until(lambda: "Retries: 9, Timeout: 7" in seen.text("#gone"))


def test_warnings_and_mistakes_are_said_at_their_places(seen: Seen, tmp_path: Path) -> None:
    text = EXAMPLE + "faults:\n  - {at: 20 s, for: 5 s, power_off: slave3}\n"
    (tmp_path / "warned.yaml").write_text(text, "utf-8")
    opened(seen, "warned.yaml")
    seen.until(lambda: "faults: 1" in seen.text("#also"))
    assert not seen.text("#warnings")
    seen.put("#stations", 3)
    seen.until(lambda: "it is never polled" in seen.text("#warnings"))
    seen.settle()
    seen.click("#warnings .jump")
    seen.until(lambda: seen.js("return document.activeElement.id") == "yaml")
    seen.put("#duration", 1)
    seen.click("#run")
    seen.until(lambda: event(seen) == "finished")
    assert "begins at 20 s, after the end of the run" in seen.text("#run-verdict")
    own = EXAMPLE.replace("  - name: master\n", "  - name: master\n    inputs: {X0: {csv: own.csv}}\n")
    (tmp_path / "own.csv").write_text("time,value\nx,1\n", "utf-8")
    (tmp_path / "beside.yaml").write_text(own, "utf-8")
    seen.click("[data-reset=stations]")
    seen.settle()
    opened(seen, "beside.yaml")
    seen.until(lambda: "own.csv, line 2, column 1: is 'x'" in seen.text("#problems"))
    assert not seen.window.find_elements("css selector", "#problems .jump")  # it is no place in this text
