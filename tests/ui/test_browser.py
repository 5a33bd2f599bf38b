"""The page in a real browser: its sliders and their answers, languages, widths, names that are hostile."""

from __future__ import annotations

import json
import math
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import bussim
from bussim.scenario import builtin
from tests.ui.asking import EXAMPLE, Page
from tests.ui.window import IN_A_BROWSER, Seen, server

pytestmark = IN_A_BROWSER
#: What stays Latin on a Chinese page: registers, names, units, codes and goals.
LATIN = re.compile(
    r"[DMK]\d+|N:N|MOV|LD\b|Modbus|bussim|uPlot|YAML|English|PLC|END\b|STOP|RUN|absent_station|full|probe|\bbad\b|typical|quiet|attempts|"
    r"retries\+1|retries|master|slave\d|pw10|fx\w+|COM\d|CPAVL|\bms\b|\b\d*e-?\d+|\bmode\b|stations"
)
PICTURE = (
    "return [...document.querySelectorAll('#curve canvas, #trade canvas')].map(c => c.toDataURL()).join()"
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("workspace")
    shutil.copy(builtin.folder() / "electrical_noise.yaml", found / "noise.yaml")
    return found


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    with server(folder, "--lang", "en") as (_, found):
        yield found


@pytest.fixture
def seen(window: Any, address: str) -> Seen:
    found = Seen(window, address)
    found.load()
    return found


def up(ms: float) -> str:
    return f"{math.ceil(ms * 10 - 1e-6) / 10:,.10g} ms"


def is_shown(seen: Seen, page: Page) -> None:
    """The figures on the page are the solver's of the line that the page has."""
    line = seen.line()
    law, size = page.ask("law", **line), page.ask("size", **line, goals=["errors<=1/y", "ride>=100ms"])
    figures, shown = law["figures"], seen.figures()
    assert shown["mean"] == up(figures["mean_ms"])
    assert shown["longest"] == up(figures["worst_case_ms"])
    judged = size["rows"][-1]
    assert shown["dead"] == up(judged["one_dead_ms"])
    assert shown["detect"] == up(judged["detect_ms"]["mean"])
    assert shown["ride"] == f"{math.floor(figures['ride_through_ms']['silence'] + 1e-6):,} ms"
    errors = judged["false_errors_per_year"]
    assert (shown["errors"] == "practically never") == (errors < 1e-3)
    if errors >= 1e-3:
        assert errors <= float(shown["errors"].replace(",", "")) <= max(2 * errors, 1)
    curve = law["fan"][-1]["law"] if law["fan"] else law["law"]
    last = json.loads(seen.one("#curve").get_attribute("data-last"))
    assert last == [curve[0][-1], curve[1][-1]]
    best = size["sizing"]["recommended"]
    if best:
        assert f"MOV K{best['D8179']} D8179" in seen.text("#program")
        assert f"MOV K{best['D8180']} D8180" in seen.text("#program")


def test_each_slider_moves_by_keys_and_every_figure_with_it(seen: Seen, tmp_path: Path) -> None:
    from selenium.webdriver.common.keys import Keys

    page, ids = Page(tmp_path), ("retries", "timeout", "scan", "stations")
    for key in ids:
        for name in (Keys.HOME, Keys.ARROW_RIGHT):
            before = seen.js(PICTURE)
            seen.one(f"#{key}").send_keys(name)
            seen.settle()
        assert key == "scan" or seen.js(PICTURE) != before
        assert seen.one(f"#{key}").get_attribute("value") == seen.one(f"#{key}-box").get_attribute("value")
        is_shown(seen, page)
    seen.click("[data-mode='4']")
    seen.settle()
    is_shown(seen, page)
    for key in ids:
        seen.click(f"[data-reset={key}]")
    seen.settle()
    assert seen.line()["form"] == {"mode": 4}
    for _ in range(13):
        seen.click("#undo")
    seen.settle()
    assert seen.line() == {"text": EXAMPLE, "form": {}}


def test_the_recommended_setting_is_used_and_copied(seen: Seen, tmp_path: Path) -> None:
    seen.window.execute_cdp_cmd(
        "Browser.grantPermissions", {"permissions": ["clipboardReadWrite", "clipboardSanitizedWrite"]}
    )
    assert "misses: false station errors" in seen.text("#verdict")
    for part in ("verdict", "tiles", "program", "copy"):  # without scrolling
        bottom = "return document.getElementById(arguments[0]).getBoundingClientRect().bottom - innerHeight"
        assert seen.js(bottom, part) <= 0
    seen.click("#use")
    seen.settle()
    assert "D8179 = 4, D8180 = 5 meets all goals" in seen.text("#verdict")
    assert "It is the recommended setting." in seen.text("#verdict")
    best = bussim.size(bussim.loads(EXAMPLE)).links["link"].recommended
    assert best is not None
    at_bad = r"With noise at the level bad a link scan takes ([\d.]+) ms while a station is dead, instead of ([\d.]+) ms;"
    shown = re.search(at_bad, seen.text("#verdict"))
    assert shown is not None
    for text, key in zip(shown.groups(), ("one_dead_ms", "mean_ms"), strict=True):  # both with the same noise
        assert abs(float(text) - best.to_json()[key]) < 0.1
    assert not seen.one("#use").is_enabled()
    assert (seen.one("#retries").get_attribute("value"), seen.one("#timeout-box").get_attribute("value")) == (
        "4",
        "5",
    )
    is_shown(seen, Page(tmp_path))
    seen.one("#copy").click()
    seen.until(lambda: seen.text("#copied") == "copied")
    copied = seen.window.execute_async_script(
        "navigator.clipboard.readText().then(arguments[0], e => arguments[0](String(e)))"
    )
    assert [line.partition("  ;")[0] for line in copied.splitlines()] == [
        "LD M8002",
        "MOV K4 D8179",
        "MOV K5 D8180",
    ]
    seen.put("#goal-errors", "0.001")
    seen.settle()
    assert "MOV K5 D8179" in seen.text("#program")


def test_noise_that_is_not_known_has_three_curves_and_noise_that_is_has_one(
    seen: Seen, tmp_path: Path
) -> None:
    page, curve = Page(tmp_path), "return document.getElementById('curve').dataset.curves"
    assert seen.js(curve) == "3"
    seen.click("[name=noise][value=ber]")
    seen.settle()
    assert seen.js(curve) == "1"
    seen.put("#ber", "-4.3")
    seen.settle()
    is_shown(seen, page)
    seen.click("#keep")
    seen.put("#retries", "8")
    seen.settle()
    assert seen.js(curve) == "2"
    assert "kept" in seen.text("#tiles")
    seen.js("document.querySelector('[name=noise][value=burst]').click()")
    assert seen.one("#tiles").get_attribute("aria-busy") == "true"  # not of the bursts yet, and marked
    seen.until(lambda: seen.one("#curve").get_attribute("aria-busy") == "false")
    assert seen.figures()["mean"] == up(page.ask("law", **seen.line())["figures"]["mean_ms"])


def test_after_many_moves_every_figure_is_of_the_last_one(seen: Seen, tmp_path: Path) -> None:
    unmarked = seen.window.execute_async_script(
        """const done = arguments[0], retries = document.getElementById('retries'), tiles = document.getElementById('tiles');
        let move = 0, wrong = 0;
        const timer = setInterval(() => {
          retries.value = String((move * 7) % 11);
          retries.dispatchEvent(new Event('input'));
          if (tiles.getAttribute('aria-busy') !== 'true') wrong += 1;
          if (++move === 60) { clearInterval(timer); done(wrong); }
        }, 33);"""
    )
    assert unmarked == 0
    seen.settle()
    assert seen.line()["form"] == {"retries": (59 * 7) % 11}
    is_shown(seen, Page(tmp_path))


def test_a_station_is_switched_off_and_a_dot_is_taken(seen: Seen, tmp_path: Path) -> None:
    seen.click("[data-off=slave2]")
    seen.settle()
    assert "Stations that are off: slave2." in seen.text("#verdict")
    is_shown(seen, Page(tmp_path))
    seen.click("#table tbody tr:nth-child(7) button")
    seen.settle()
    assert seen.line()["form"] == {"off": ["slave2"], "retries": 6}
    seen.click("[data-off=slave2]")
    seen.settle()
    assert seen.line()["form"]["off"] == []


def test_another_plc_has_its_own_modes(seen: Seen, tmp_path: Path) -> None:
    seen.js(
        "const e = arguments[0]; e.value = 'fx1s'; e.dispatchEvent(new Event('change'))", seen.one("#profile")
    )
    seen.settle()
    assert seen.line()["form"] == {"profile": "fx1s", "mode": 0}
    shown = "return [...document.querySelectorAll('#mode button')].filter(e => e.offsetParent).map(e => e.textContent)"
    assert seen.js(shown) == ["0"]
    is_shown(seen, Page(tmp_path))


def test_counters_read_on_site_become_noise(seen: Seen, tmp_path: Path) -> None:
    seen.click("[name=noise][value=counters]")
    for number, count in enumerate((500, 505, 498), 1):
        seen.put(f"[data-counts=slaves][data-station='{number}']", count)
    seen.click("#work-out")
    seen.until(lambda: "Enter the master's counts" in seen.text("#counters-said"))
    assert "slave1, slave2, slave3" in seen.text("#counters-said")
    assert "noise" not in seen.line()["form"]
    for number in (1, 2, 3):
        seen.put(f"[data-counts=master][data-station='{number}']", 1)
    seen.click("#work-out")
    seen.until(lambda: "upper limits" in seen.text("#counters-said"))
    seen.settle()
    assert seen.line()["form"]["noise"]["kind"] == "counters"
    is_shown(seen, Page(tmp_path))


@pytest.mark.parametrize("width", [400, 768, 1280])
@pytest.mark.parametrize("lang", ["en", "zh"])
def test_it_fits_is_named_and_loads_nothing_from_elsewhere(
    window: Any, address: str, lang: str, width: int
) -> None:
    seen = Seen(window, address)
    window.get_log("browser")
    seen.load(width=width)
    seen.unfold(lang)
    assert seen.js("return document.documentElement.scrollWidth <= innerWidth")
    unnamed = """return [...document.querySelectorAll('input, select, textarea, button')].filter(e => e.offsetParent
      && !(e.labels?.[0]?.textContent.trim() || e.getAttribute('aria-label') || e.textContent.trim()
      || document.getElementById(e.getAttribute('aria-labelledby'))?.textContent)).map(e => e.outerHTML)"""
    assert seen.js(unnamed) == []
    small = """return innerWidth > 500 ? [] : [...document.querySelectorAll('button, summary, input:not([type=radio], [type=checkbox]), select')].filter(
      e => e.offsetParent && e.getBoundingClientRect().height < 43.5).map(e => e.outerHTML)"""
    assert seen.js(small) == []
    if width == 400:
        for slider in ("stations", "retries", "timeout", "scan"):
            seen.js("document.getElementById(arguments[0]).scrollIntoView({block: 'center'})", slider)
            top, bottom = seen.js(
                "const r = document.getElementById('strip').getBoundingClientRect(); return [r.top, r.bottom]"
            )
            assert 0 <= top < bottom <= 131 + top
    if lang == "zh":
        left = LATIN.sub(
            "",
            seen.js(
                "return document.querySelector('header').innerText + document.querySelector('main').innerText"
            ),
        )
        assert not re.findall(r"[A-Za-z]{2,}", left)
        assert seen.js("return document.documentElement.lang") == "zh-Hans"
        seen.load(width=width, fresh=False)
        assert "推荐" in seen.text("#verdict")
    own = address.partition("#")[0]
    loaded = seen.js("return performance.getEntriesByType('resource').map(e => e.name)")
    assert loaded
    assert [url for url in loaded if not url.startswith((own, "data:"))] == []
    assert window.get_log("browser") == []


def test_names_are_never_markup(window: Any, tmp_path: Path) -> None:
    name = "<img src=x onerror=\"document.title='hit'\">'\"é中" + "x" * 140
    file = tmp_path / "<b>hostile&amp;.yaml"
    file.write_text(EXAMPLE.replace("name: 4 stations, mode 2", f"name: {json.dumps(name)}"), "utf-8")
    with server(tmp_path, str(file)) as (_, address):
        seen = Seen(window, address)
        seen.load()
        seen.click("#open")
        seen.until(lambda: seen.js("return document.querySelectorAll('#entries li').length > 1"))
        assert seen.one("#name").get_attribute("value") == name
        assert seen.js("return document.querySelectorAll('img, #entries b').length") == 0
        assert seen.js("return document.documentElement.scrollWidth <= innerWidth")
        assert seen.js("return document.title").startswith("<img src=x")
        seen.put("#name", "\u202e" + name * 20)  # a name that is refused is quoted
        seen.until(lambda: "expected one line of at most 200" in seen.text("#name-bad"))
        assert seen.js("return document.querySelectorAll('img').length") == 0
        assert seen.js("return document.documentElement.scrollWidth <= innerWidth")
