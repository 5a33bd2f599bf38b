"""The report in a real browser: it renders, its numbers are those of the run, every reader can use it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from bussim.cli import main
from tests.report.browser import broken_rules, chromium, show

pytestmark = [
    pytest.mark.slow,
    # Selenium leaves its sockets to the garbage collector.
    pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"),
]


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pages")
    press = ["run", "press_line", "--trace", "--duration", "30s", "--out"]
    assert main([*press, str(folder / "press")]) == 0
    other = ["--set", "plcs.press1.nn.retries=2", "--seed", "8"]
    assert main([*press, str(folder / "other"), *other]) == 0
    assert main(["report", str(folder / "press"), "-o", str(folder / "one.html")]) == 0
    assert main(["report", str(folder / "press"), "-o", str(folder / "chinese.html"), "--lang", "zh"]) == 0
    both = [str(folder / "press"), str(folder / "other")]
    assert main(["report", *both, "-o", str(folder / "two.html")]) == 0
    ports = ["run", "nn_with_modbus", "--duration", "10s", "--trace", "--out", str(folder / "ports")]
    assert main(ports) == 0
    assert main(["report", str(folder / "ports"), "-o", str(folder / "ports.html")]) == 0
    words = ["run", "counter_preset", "--duration", "10s", "--out"]
    assert main([*words, str(folder / "words")]) == 0
    assert main([*words, str(folder / "slower"), "--set", "plcs.line.scan.mean=20ms"]) == 0
    both = [str(folder / "words"), str(folder / "slower")]
    assert main(["report", *both, "-o", str(folder / "latency.html")]) == 0
    return folder


@pytest.fixture(scope="module")
def window() -> Iterator[Any]:
    with chromium() as found:
        yield found


def looked_up(summary: dict[str, Any], path: str) -> Any:
    """The value at a JSON pointer."""
    value: Any = summary
    for key in path.split("/")[1:]:
        value = value[key.replace("~1", "/").replace("~0", "~")]
    return value


def assert_shows(text: str, value: Any, path: str) -> None:
    """The text of a cell is the value, to the digits that it shows."""
    text = text.split(" ≠")[0].strip()
    if value is None:
        assert text == "–", path
    elif path.endswith("/bus_load") and text.endswith("%"):
        assert float(text.removesuffix("%")) == pytest.approx(100 * value, abs=0.0051), path
    elif text in ("ON", "off", "OFF"):
        assert value == (text == "ON"), path
    elif re.fullmatch(r"/plcs/[^/]+/registers/D82(1[1-8])", path):
        assert int(text, 16) == value, path
    elif isinstance(value, str):
        assert text == value, path
    elif isinstance(value, dict | list):
        assert text == (", ".join(map(str, value)) or "none"), path
    else:
        decimals = len(text.partition(".")[2])
        assert float(text.replace(",", "")) == pytest.approx(value, abs=0.51 * 10**-decimals), path


@pytest.mark.parametrize(
    ("page", "runs"),
    [
        ("one.html", ["press"]),
        ("chinese.html", ["press"]),
        ("two.html", ["press", "other"]),
        ("ports.html", ["ports"]),
        ("latency.html", ["words", "slower"]),
    ],
)
def test_every_cell_equals_the_summary(pages: Path, window: Any, page: str, runs: list[str]) -> None:
    show(window, pages / page)
    summaries = [json.loads((pages / run / "summary.json").read_text("utf-8")) for run in runs]
    window.execute_script("for (const each of document.querySelectorAll('details')) each.open = true")
    cells = window.execute_script(
        "return [...document.querySelectorAll('td[data-path]')].map(c => [c.dataset.path, +c.dataset.run, c.innerText])"
    )
    assert len(cells) > 80 * len(runs)
    for path, run, text in cells:
        assert_shows(text, looked_up(summaries[run - 1], path), path)
    paths = {path for path, _, _ in cells}
    for key in ("p50", "p99", "max"):
        assert f"/links/link/scan_time_ms/{key}" in paths
    if page == "ports.html":
        ports = summaries[0]["ports"]
        assert ports
        for port in ports:
            assert f"/ports/{port}/transactions" in paths
            assert any(path.startswith(f"/ports/{port}/polls/") for path in paths)
        assert {f"/devices/{device}/requests" for device in summaries[0]["devices"]} <= paths
    elif page == "latency.html":
        for run in (1, 2):
            here = {path for path, number, _ in cells if number == run}
            for name, key in (("full-box", "unseen"), ("preset", "delivered")):
                entry = f"/latency/{name}"
                assert {f"{entry}/{key}", f"{entry}/ms/p95", f"{entry}/parts_ms/wire/mean"} <= here
                assert {f"{entry}/bound_ms/no error", f"{entry}/bound_ms/every retry spent"} <= here
    else:
        assert "/links/link/failed_attempts/1/01" in paths
        assert "/plcs/press1/registers/D8180" in paths


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("width", [400, 1280])
@pytest.mark.parametrize("page", ["one.html", "two.html", "ports.html", "latency.html"])
def test_it_renders_without_an_error_and_loads_nothing(
    pages: Path, window: Any, page: str, width: int, dark: bool
) -> None:
    window.get_log("browser"), window.get_log("performance")
    show(window, pages / page, width=width, dark=dark)
    assert window.execute_script("return document.documentElement.dataset.ready") == "true"
    assert window.get_log("browser") == []
    messages = [json.loads(entry["message"])["message"] for entry in window.get_log("performance")]
    asked = [m["params"]["request"]["url"] for m in messages if m["method"] == "Network.requestWillBeSent"]
    assert asked
    assert all(url.startswith(("file:", "data:")) for url in asked)
    # Nothing is wider than the window: what is wide scrolls by itself.
    assert window.execute_script("return document.documentElement.scrollWidth <= innerWidth")
    # Every chart has been drawn: its canvas is not of one colour.
    drawn = window.execute_script(
        """return [...document.querySelectorAll('figure canvas')].map(canvas => {
          const {data} = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
          return new Set(new Uint32Array(data.buffer)).size;
        })"""
    )
    assert len(drawn) >= 4
    assert min(drawn) > 10


def test_charts_zoom_and_show_what_is_under_the_pointer(pages: Path, window: Any) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    show(window, pages / "one.html")
    for figure in window.find_elements("css selector", "figure[data-chart]"):
        plot = figure.find_element("css selector", ".u-over")
        window.execute_script("arguments[0].scrollIntoView({block: 'center'})", plot)
        canvas = figure.find_element("css selector", "canvas")
        whole = window.execute_script("return arguments[0].toDataURL()", canvas)
        ActionChains(window).move_to_element(plot).click_and_hold().move_by_offset(80, 0).release().perform()
        assert window.execute_script("return arguments[0].toDataURL()", canvas) != whole
        named = {b.text: b for b in figure.find_elements("css selector", ".tools button")}
        named["Show all"].click()
        if "Not in this first view" in figure.text:
            assert named["Logarithmic"].get_attribute("aria-pressed") == "true"
            plot = figure.find_element("css selector", ".u-over")  # drawn anew
        texts = set()
        width = plot.size["width"]
        for x in range(-width // 2 + 4, width // 2 - 4, 61):
            for y in (10 - plot.size["height"] // 2, 0):
                ActionChains(window, duration=0).move_to_element_with_offset(plot, x, y).perform()
                texts.add(
                    window.execute_script("return arguments[0].querySelector('.tip').textContent", figure)
                )
        assert any("ms" in text for text in texts), figure.text


def test_parts_of_a_latency_are_shown_under_the_pointer(pages: Path, window: Any) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    show(window, pages / "latency.html")
    summary = json.loads((pages / "words" / "summary.json").read_text("utf-8"))
    entry = summary["latency"]["preset"]
    figures = window.find_elements("css selector", "#run1-latency figure")
    histogram, parts = figures[-2:]
    shown: list[set[str]] = []
    for figure in (histogram, parts):
        plot = figure.find_element("css selector", ".u-over")
        window.execute_script("arguments[0].scrollIntoView({block: 'center'})", plot)
        size, found = plot.size, set()
        for x in range(-size["width"] // 2 + 2, size["width"] // 2 - 1, 7):
            ActionChains(window, duration=0).move_to_element_with_offset(plot, x, 0).perform()
            tip = window.execute_script("return arguments[0].querySelector('.tip').textContent", figure)
            found.add(tip)
        shown.append(found)
    bound = f"at worst with no error: {entry['bound_ms']['no error']:.3f} ms"
    assert all(any(bound in text for text in found) for found in shown)
    assert any(" readings" in text for text in shown[0])
    # The middle lane is the mean.
    for part, words in (("wire", "on the wire"), ("destination", "since the frame came, until it was read")):
        assert any(f"{words} {entry['parts_ms'][part]['mean']:.3f} ms" in text for text in shown[1])
    for figure in (histogram, parts):
        assert bound in figure.find_element("css selector", ".legend").text


def test_keyboard_alone_reaches_and_works_everything(pages: Path, window: Any) -> None:
    from selenium.webdriver.common.keys import Keys

    show(window, pages / "one.html")
    body = window.find_element("tag name", "body")
    body.send_keys(Keys.TAB)
    first = window.switch_to.active_element
    assert first.text == "Skip to the content"
    assert first.is_displayed()
    first.send_keys(Keys.ENTER)
    assert window.execute_script("return document.activeElement.id") == "content"
    seen = []
    for _ in range(60):
        window.switch_to.active_element.send_keys(Keys.TAB)
        style = window.execute_script(
            """const e = document.activeElement, s = getComputedStyle(e);
            return [e.tagName, s.outlineStyle, parseFloat(s.outlineWidth), e.getAttribute('aria-label') ?? e.innerText]"""
        )
        if style[0] == "BODY":
            break
        assert style[1] != "none", style
        assert style[2] >= 2, style
        assert style[3].strip(), style
        seen.append(style[0])
    assert {"BUTTON", "SUMMARY", "DIV", "PRE"} <= set(seen)
    zoom = window.find_element("css selector", "figure .tools button")
    canvas = window.find_element("css selector", "figure canvas")
    before = window.execute_script("return arguments[0].toDataURL()", canvas)
    zoom.send_keys(Keys.ENTER)
    assert window.execute_script("return arguments[0].toDataURL()", canvas) != before


@pytest.mark.parametrize("page", ["one.html", "two.html", "ports.html", "latency.html"])
def test_a_screen_reader_finds_its_way(pages: Path, window: Any, page: str) -> None:
    show(window, pages / page)
    found = window.execute_script(
        """const all = (what) => [...document.querySelectorAll(what)];
        return {
          lang: document.documentElement.lang, title: document.title,
          landmarks: ['header', 'nav', 'main', 'footer'].map(name => all(`body > ${name}`).length),
          h1: all('h1').length,
          levels: all('h1,h2,h3,h4').map(h => +h.tagName[1]),
          ids: all('[id]').map(e => e.id),
          labelled: all('[aria-labelledby]').flatMap(e => e.getAttribute('aria-labelledby').split(' ').map(id => document.getElementById(id)?.textContent ?? '')),
          named: all('nav, section, figure, [role=group], pre, button').map(e =>
            e.getAttribute('aria-label') ?? e.getAttribute('aria-labelledby') ?? ''),
          pictures: all('[role=img]').map(e => e.getAttribute('aria-label')),
          figures: all('figure').length,
          tables: all('table').map(t => [t.caption?.textContent ?? '', [...t.querySelectorAll('th')].every(h => h.scope)]),
          links: all('a[href^="#"]').map(a => document.getElementById(a.getAttribute('href').slice(1)) !== null),
        }"""
    )
    assert found["lang"] == "en"
    assert "report" in found["title"]
    assert found["landmarks"] == [1, 1, 1, 1]
    assert found["h1"] == 1
    for before, after in zip(found["levels"], found["levels"][1:], strict=False):
        assert after <= before + 1, "a level of heading is skipped"
    assert len(set(found["ids"])) == len(found["ids"])
    assert all(found["labelled"])
    assert all(found["named"])
    assert len(found["pictures"]) == found["figures"] > 3
    assert all(len(text) > 20 for text in found["pictures"])
    assert all(caption and scoped for caption, scoped in found["tables"])
    assert all(found["links"])


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("page", ["one.html", "two.html", "ports.html", "latency.html"])
def test_no_rule_of_access_is_broken(pages: Path, window: Any, page: str, dark: bool) -> None:
    """Contrast, names and roles by an independent checker."""
    show(window, pages / page, dark=dark)
    assert broken_rules(window) == []


def test_dark_is_dark(pages: Path, window: Any) -> None:
    backgrounds = []
    for dark in (False, True):
        show(window, pages / "one.html", dark=dark)
        colour = window.execute_script("return getComputedStyle(document.body).backgroundColor")
        backgrounds.append(sum(map(int, re.findall(r"\d+", colour)[:3])))
    assert backgrounds[0] > 700 > 150 > backgrounds[1]


def test_it_prints_in_light_colours_on_paper(pages: Path, window: Any) -> None:
    import base64

    show(window, pages / "one.html", dark=True)
    done = window.execute_cdp_cmd(
        "Page.printToPDF", {"printBackground": True, "paperWidth": 8.27, "paperHeight": 11.7}
    )
    assert base64.b64decode(done["data"]).startswith(b"%PDF")
    assert window.get_log("browser") == []
    features = [{"name": "prefers-color-scheme", "value": "dark"}]
    window.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print", "features": features})
    assert (
        window.execute_script("return getComputedStyle(document.body).backgroundColor")
        == "rgb(255, 255, 255)"
    )
    assert window.execute_script("return getComputedStyle(document.querySelector('nav')).display") == "none"


def test_charts_on_paper_are_light_whatever_the_screen_is(pages: Path, window: Any) -> None:
    drawn = []
    for dark in (False, True):
        show(window, pages / "one.html", dark=dark)
        before = window.execute_script("return document.querySelector('figure canvas').toDataURL()")
        paper = window.execute_script(
            """dispatchEvent(new Event('beforeprint'));
            return [...document.querySelectorAll('figure canvas')].map(canvas => canvas.toDataURL())"""
        )
        window.execute_script("dispatchEvent(new Event('afterprint'))")
        assert window.execute_script("return document.querySelector('figure canvas').toDataURL()") == before
        drawn.append(paper)
    assert drawn[0] == drawn[1]


def test_a_name_from_a_scenario_is_never_markup(tmp_path: Path, window: Any) -> None:
    evil = "</script><script>document.title='x'</script><img src=x onerror=alert(1)>&{{7*7}}"
    scenario = tmp_path / "evil.yaml"
    scenario.write_text(
        f"""schema: 1
name: "{evil}"
duration: 1 s
seed: 1
buses: [{{name: link, nn: true}}]
plcs:
  - {{name: a, scan: 5 ms, nn: {{bus: link, port: COM4, station: 0, slaves: 1}}}}
  - {{name: b, scan: 5 ms, nn: {{bus: link, port: COM4, station: 1}}}}
""",
        encoding="utf-8",
    )
    assert main(["run", str(scenario), "--trace", "--out", str(tmp_path / "run")]) == 0
    assert main(["report", str(tmp_path / "run")]) == 0
    window.get_log("browser")
    show(window, tmp_path / "run" / "report.html")
    assert window.title == f"{evil}: simulation report"
    assert window.find_element("tag name", "h1").text == f"{evil}: simulation report"
    assert window.execute_script("return document.images.length") == 0
    assert window.get_log("browser") == []


def test_charts_of_a_chinese_page_say_nothing_in_english(pages: Path, window: Any) -> None:
    window.get_log("browser")
    show(window, pages / "chinese.html")
    texts = window.execute_script(
        """const plots = [...document.querySelectorAll("figure.chart")];
        const over = plots.map((figure) => figure.querySelector(".u-over"));
        const tips = over.map((each, number) => {
          const box = each.getBoundingClientRect();
          const at = { clientX: box.left + box.width / 2, clientY: box.top + box.height / 3, bubbles: true };
          each.dispatchEvent(new MouseEvent("mouseenter", at));
          each.dispatchEvent(new MouseEvent("mousemove", at));
          return plots[number].querySelector(".tip").textContent;
        });
        return [...plots.map((figure) => figure.innerText), ...tips,
          ...[...document.querySelectorAll(".tools button")].map((each) => each.getAttribute("aria-label"))];"""
    )
    assert len(texts) > 20
    names = {"press", "link", "uPlot", "END", "PLC"}
    assert {word for text in texts for word in re.findall("[A-Za-z]{3,}", text)} <= names
    assert "显示全部" in texts[0]
    assert not [each for each in window.get_log("browser") if each["level"] == "SEVERE"]
