"""Opening, saving, simulating and printing on the page, and a server that is gone."""

from __future__ import annotations

import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from difflib import ndiff
from pathlib import Path
from typing import Any

import pytest

from bussim.scenario import builtin
from tests.ui.window import IN_A_BROWSER, Seen, event, opened, server

pytestmark = IN_A_BROWSER


@pytest.fixture
def seen(window: Any, tmp_path: Path) -> Iterator[Seen]:
    shutil.copy(builtin.folder() / "electrical_noise.yaml", tmp_path / "noise.yaml")
    with server(tmp_path, str(tmp_path / "noise.yaml"), "--lang", "en") as (process, address):
        found = Seen(window, address)
        found.process = process  # type: ignore[attr-defined]
        found.load()
        yield found


def children(process: subprocess.Popen[str]) -> list[int]:
    found = subprocess.run(["pgrep", "-P", str(process.pid)], capture_output=True, text=True, check=False)
    return [int(each) for each in found.stdout.split()]


def test_a_simulation_rises_finishes_stops_and_fails(seen: Seen, tmp_path: Path) -> None:
    seen.put("#duration", "20")
    seen.click("#run")
    seen.until(lambda: event(seen) == "finished")
    assert "Mean link scan: simulated" in seen.text("#run-verdict")
    assert seen.js("return document.querySelectorAll('#histogram canvas, #worst canvas').length") == 2
    assert (tmp_path / "runs" / "ui" / "summary.json").is_file()
    seen.put("#duration", "100000")
    seen.click("#trace")
    seen.click("#run")
    values = set()
    seen.until(lambda: values.add(seen.one("#progress").get_attribute("value")) or len(values) > 2)
    seen.put("#retries", "2")
    seen.until(lambda: "another setting" in seen.text("#run-said"))
    seen.settle()  # sliders go on meanwhile
    seen.click("#stop")
    seen.until(lambda: event(seen) == "stopped")
    assert [each.name for each in (tmp_path / "runs").glob("*.incomplete") if each.is_dir()] == [
        "ui-2.incomplete"
    ]
    assert "finished" not in seen.text("#run-said")
    assert "Mean link scan" in seen.text("#run-verdict")  # the last finished one stays
    seen.click("#run")
    seen.until(lambda: event(seen) == "progress")
    process = seen.process  # type: ignore[attr-defined]
    before = children(process)
    (simulating,) = [each for each in before if b"popen_loky" in Path(f"/proc/{each}/cmdline").read_bytes()]
    import os

    os.kill(simulating, signal.SIGKILL)
    seen.until(lambda: event(seen) == "failed")
    assert "The simulation failed" in seen.text("#run-said")


def test_mistakes_are_jumped_to_mended_and_saved_and_only_they_differ(seen: Seen, tmp_path: Path) -> None:
    file = tmp_path / "noise.yaml"
    good = file.read_text("utf-8")
    bad = good.replace("retries: 3", "retrise: 3").replace("ber: 2.0e-5", "ber: 2.0")
    (tmp_path / "bad.yaml").write_text(bad, "utf-8")
    seen.click("#open")
    seen.until(lambda: seen.js("return document.querySelector('[data-entry=\"bad.yaml\"]')"))
    seen.click("[data-entry='bad.yaml']")
    jumps = seen.until(lambda: seen.window.find_elements("css selector", "#problems button"))
    assert len(jumps) == 2
    for jump, wrong in zip(jumps, ("retrise", "2.0"), strict=True):
        jump.click()
        at = seen.js("return document.activeElement.id === 'yaml' && document.activeElement.selectionStart")
        assert bad[at:].startswith(wrong)
    seen.js(
        "const y = document.getElementById('yaml'); y.value = y.value.replace('retrise', 'retries').replace('ber: 2.0}', 'ber: 2.0e-5}')"
    )
    locked = "const e = document.getElementById('controls'); return [e.inert, getComputedStyle(e).visibility]"
    assert seen.js(locked) == [True, "hidden"]  # it never was a line
    seen.click("#apply")
    seen.settle()
    assert seen.js(locked) == [False, "visible"]
    right = seen.one("#yaml").get_attribute("value")
    seen.put("#yaml", right.replace("timeout: 50 ms", "timeout: 50 mz"))
    seen.click("#apply")
    seen.until(lambda: seen.js(locked) == [True, "visible"])  # with what the last line was
    seen.click("#undo")
    seen.until(lambda: seen.js(locked) == [False, "visible"])
    seen.settle()
    seen.put("#timeout", "7")
    seen.settle()
    assert seen.text("#file") == "changed, not saved"
    seen.click("#save")
    seen.click("#save-now")
    seen.until(lambda: seen.text("#file") == "saved")
    new = (tmp_path / "bad.yaml").read_text("utf-8")
    lines = [line for line in ndiff(bad.splitlines(), new.splitlines()) if line[0] in "+-"]
    assert [line[2:] for line in lines if line[0] == "+"] == [
        "    nn: {bus: link, port: COM3, station: 0, slaves: 3, mode: 2, retries: 3, timeout: 70 ms}",
        "  - {name: cable, bus: link, ber: 2.0e-5}",
    ]
    assert len(lines) == 4
    seen.put("#retries", "9")
    (tmp_path / "bad.yaml").write_text(good, "utf-8")
    seen.click("#save")
    seen.click("#save-now")
    seen.until(lambda: "changed by another program" in seen.text("#save-bad"))
    assert (tmp_path / "bad.yaml").read_text("utf-8") == good
    seen.put("#target", "other.yaml")
    seen.click("#save-now")
    seen.until((tmp_path / "other.yaml").exists)
    assert "retries: 9, timeout: 70 ms" in (tmp_path / "other.yaml").read_text("utf-8")


def test_the_mean_of_a_known_noise_is_one_figure(seen: Seen) -> None:
    """Sizing has the worst mean of several views of the noise; the sentence has the tile's."""
    assert f"instead of {seen.figures()['mean']}; false station errors" in seen.text("#verdict")


def test_a_value_out_of_range_leaves_the_last_valid_figures_marked(seen: Seen) -> None:
    before = seen.figures()
    seen.put("#timeout-box", "1")
    seen.until(lambda: seen.one("#timeout-box").get_attribute("aria-invalid") == "true")
    assert seen.text("#timeout-bad") == "Timeout: from 5 to 225"
    assert seen.figures() == before
    assert seen.one("#tiles").get_attribute("aria-busy") == "true"
    seen.put("#timeout-box", "5")
    seen.settle()
    assert not seen.one("#problems").is_displayed()


def test_a_server_that_is_gone_is_said_and_the_line_is_kept(seen: Seen) -> None:
    seen.put("#retries", "8")
    seen.settle()
    seen.process.terminate()  # type: ignore[attr-defined]
    seen.process.wait(20)  # type: ignore[attr-defined]
    seen.put("#retries", "9")
    seen.until(lambda: seen.one("#gone").is_displayed())
    assert "this page keeps your line" in seen.text("#gone")
    assert seen.line()["form"]["retries"] == 9
    assert not seen.one("#problems").is_displayed()
    assert seen.one("#tiles").get_attribute("aria-busy") == "true"


def test_quit_ends_the_server(seen: Seen) -> None:
    seen.click("#quit")
    seen.until(lambda: "bussim has ended" in seen.text("#gone"))
    end = time.monotonic() + 20
    while seen.process.poll() is None:  # type: ignore[attr-defined]
        assert time.monotonic() < end
        time.sleep(0.05)
    assert seen.process.returncode == 0  # type: ignore[attr-defined]


def test_a_line_without_a_law_has_what_sizing_knows_beside_its_sliders(seen: Seen) -> None:
    seen.load(width=400)
    opened(seen, "press_line")
    seen.until(lambda: "three presses" in str(seen.one("#name").get_attribute("value")))
    seen.settle()
    shown = "return document.querySelector('#strip [data-figure=dead]').innerText"
    assert seen.one("#strip").is_displayed()
    assert seen.js(shown) == "348.9 ms"
    assert "Recommended: D8179 = 4, D8180 = 5." in seen.text("#strip-law")
    top, bottom = seen.js(
        "const r = document.getElementById('strip').getBoundingClientRect(); return [r.top, r.bottom]"
    )
    assert bottom - top <= 131
    place = """const at = (selector) => document.querySelector(selector).getBoundingClientRect().top;
      return at('#retries') - at('[data-field=retries]')"""
    before = seen.js(place)
    seen.put("#retries", "0")
    seen.settle()
    assert seen.js(shown) != "348.9 ms"
    assert seen.one("[data-reset=retries]").is_displayed()
    assert abs(seen.js(place) - before) < 1  # the button moves nothing


def test_what_cannot_be_used_is_said_and_nothing_of_it_is_moved(seen: Seen, tmp_path: Path) -> None:
    (tmp_path / "no.yaml").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "wrong.yaml").write_text("schema: 1\n", "utf-8")
    opened(seen, "no.yaml")
    seen.until(lambda: "no.yaml cannot be read" in seen.text("#open-bad"))
    seen.put("#goal-errors", "-1")
    seen.until(
        lambda: (
            "A goal is a number above 0" in seen.js("return document.getElementById('goals-bad').textContent")
        )
    )
    assert seen.one("#recommended").get_attribute("aria-busy") == "true"
    seen.put("#goal-errors", "1")
    seen.settle()
    seen.put("#duration", "0")
    seen.click("#run")
    seen.until(lambda: seen.text("#run-said") == "time: this value is not allowed.")
    seen.click("[data-lang=zh]")
    seen.put("#stations-box", "9")
    seen.until(lambda: seen.text("#stations-bad") == "站数（含主站）：2 到 8")
    seen.click("[data-lang=en]")
    seen.click("[data-reset=stations]")
    seen.settle()
    opened(seen, "wrong.yaml")
    seen.until(lambda: "plcs is missing" in seen.text("#problems"))
    assert seen.js("return document.getElementById('controls').inert")
    assert not seen.one("#retries").is_displayed()
