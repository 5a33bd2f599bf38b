"""The page for a screen reader, by keyboard, enlarged, without motion, and on paper."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from bussim.version import __version__
from tests.report.browser import broken_rules, printed
from tests.ui.window import IN_A_BROWSER, Seen, server

pytestmark = IN_A_BROWSER


@pytest.fixture
def seen(window: Any, tmp_path: Path) -> Iterator[Seen]:
    with server(tmp_path, "--lang", "en") as (_, address):
        found = Seen(window, address)
        found.load()
        yield found


def prefer(window: Any, **features: str) -> None:
    """Set media features, with ``_`` for ``-``; without any those of the system."""
    each = [{"name": name.replace("_", "-"), "value": value} for name, value in features.items()]
    window.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": each})


def show_all(seen: Seen, width: int, lang: str) -> None:
    seen.load(width=width)
    seen.unfold(lang)
    seen.settle()


@pytest.mark.parametrize(("scheme", "width", "lang"), [("light", 1280, "zh"), ("dark", 400, "en")])
def test_no_rule_of_access_is_broken_in_any_state(seen: Seen, scheme: str, width: int, lang: str) -> None:
    """Names, roles, contrast, headings and landmarks by an independent checker."""
    prefer(seen.window, prefers_color_scheme=scheme)
    try:
        show_all(seen, width, lang)
        assert broken_rules(seen.window) == []
        for key in ("#keep", "#open", "#save"):
            seen.click(key)
        seen.put("#duration", "2")
        seen.click("#run")
        seen.until(lambda: seen.one("#run-said").get_attribute("data-event") == "finished")
        assert broken_rules(seen.window) == []
        seen.put("#retries-box", "99")
        seen.until(lambda: seen.one("#retries-bad").is_displayed())
        assert broken_rules(seen.window) == []
        seen.put("#yaml", "schema: 1\nnames: 3\n")
        seen.click("#apply")
        seen.until(lambda: seen.js("return document.querySelectorAll('#problems .jump').length"))
        assert broken_rules(seen.window) == []
    finally:
        prefer(seen.window)


def test_the_tabulator_goes_through_the_page_as_it_is_read(seen: Seen) -> None:
    """From the skip link on, every control that is shown, in the order of the page, each with its focus to be seen."""
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.keys import Keys

    wanted = seen.js("""return [...document.querySelectorAll('a[href], input, select, textarea, button, summary, [tabindex="0"]')].filter(
      e => e.checkVisibility() && !e.disabled && !(e.type === 'radio' && !e.checked)).map(e => e.id || e.textContent.trim())""")
    seen.js("document.activeElement.blur(); window.getSelection().removeAllRanges(); scrollTo(0, 0)")
    found, outlines = [], []
    for _ in wanted:
        ActionChains(seen.window).send_keys(Keys.TAB).perform()
        name, outline = seen.js("""const e = document.activeElement, s = getComputedStyle(e);
          return [e.id || e.textContent.trim(), s.outlineStyle !== 'none' || s.boxShadow !== 'none' || s.borderColor]""")
        found.append(name)
        outlines.append(outline)
    assert found == wanted
    assert {"retries", "retries-box", "copy", "run"} <= set(found)
    assert all(outlines)


@pytest.mark.parametrize(("width", "ratio"), [(640, 2), (320, 4)])
def test_enlarged_twice_and_four_times_nothing_is_cut_off(seen: Seen, width: int, ratio: int) -> None:
    """A page of 1280 px at 200 and 400 %: nothing scrolls sideways but tables, no text lies outside of its control."""
    for lang in ("en", "zh"):
        show_all(seen, width, lang)
        size = {"width": width, "height": 450, "deviceScaleFactor": ratio, "mobile": False}
        seen.window.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        time.sleep(0.2)  # charts are drawn anew when the width rests
        seen.settle()
        assert seen.js("return document.documentElement.scrollWidth <= innerWidth")
        cut = """return [...document.querySelectorAll('button, summary, label, dt, dd, output, h2, li')].filter(
          e => e.checkVisibility() && !e.closest('.hidden, .strip, .scroll') && e.scrollWidth > e.clientWidth + 1
          && getComputedStyle(e).display !== 'inline').map(e => e.outerHTML.slice(0, 200))"""
        assert seen.js(cut) == []


def test_without_motion_where_none_is_wanted(seen: Seen) -> None:
    moving = """return [...document.querySelectorAll('*')].filter(e => { const s = getComputedStyle(e);
      return s.animationName !== 'none' || s.transitionDuration.split(',').some(t => parseFloat(t) > 0) }).map(e => e.id || e.tagName)"""
    prefer(seen.window, prefers_reduced_motion="reduce")
    try:
        seen.load()
        seen.js(
            "for (const e of document.querySelectorAll('#tiles, #curve')) e.setAttribute('aria-busy', 'true')"
        )
        assert seen.js(moving) == []
    finally:
        prefer(seen.window)


@pytest.mark.parametrize("lang", ["en", "zh"])
def test_a_printed_page_says_what_a_cabinet_needs(seen: Seen, tmp_path: Path, lang: str) -> None:
    """Name, setting, program, assumptions, date and version, read back from the PDF, and both charts."""
    seen.click(f"button[data-lang={lang}]")
    first = seen.window.current_window_handle
    seen.put("#name", "Presse 3 / 压机")
    seen.put("#retries", "2")
    seen.settle()
    assert "MOV K4 D8179" in seen.text("#program")
    seen.one("#print").click()
    seen.until(lambda: len(seen.window.window_handles) == 2 or seen.one("#made").is_displayed())
    if len(seen.window.window_handles) < 2:
        seen.one("#made-link").click()
        seen.until(lambda: len(seen.window.window_handles) == 2)
    seen.window.switch_to.window(next(each for each in seen.window.window_handles if each != first))
    try:
        seen.until(lambda: seen.js("return document.documentElement.dataset.ready"))
        before = time.strftime("%Y-%m-%d")
        sheets = printed(seen.window, tmp_path / "page.pdf")
        blank = "return [...document.querySelectorAll('#curve canvas, #trade canvas')].map(c => { const e = c.cloneNode(); return e.toDataURL() === c.toDataURL(); })"
        assert seen.js(blank) == [False, False]
    finally:
        seen.window.close()
        seen.window.switch_to.window(first)
    assert len(sheets) in (1, 2)
    text = "".join("".join(sheets).split())  # where columns stand is a matter of the reader
    for wanted in (
        "Presse 3 / 压机",
        "LD M8002",
        "MOV K4 D8179",
        "MOV K5 D8180",
        f"bussim {__version__}",
        "absent_station",
    ):
        assert wanted.replace(" ", "") in text
    assert before in text or time.strftime("%Y-%m-%d") in text
    heads = {
        "en": ("The assumptions that change the answer most", "Printed on"),
        "zh": ("对结论影响最大的几项假定", "打印日期"),
    }
    for language, parts in heads.items():
        assert [each.replace(" ", "") in text for each in parts] == [language == lang] * 2
