"""The sizing page in a real browser: its sliders by keys, its figures, both languages, narrow and on paper."""

from __future__ import annotations

import json
import math
import random
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from bussim.cli import main
from bussim.exact.text import a_year
from bussim.scenario import builtin
from tests.commands.size.test_page import payload
from tests.report.browser import broken_rules, chromium, printed, show

pytestmark = [
    pytest.mark.slow,
    # Selenium leaves its sockets to the garbage collector.
    pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"),
]
STANDARD = builtin.folder() / "sizing.html"
NAMES = ("standard", "ports", "noisy", "bursts")
#: What stays Latin on a Chinese page: names of registers, buses, stations, levels, programs and goals.
LATIN = re.compile(
    r"N:N with Modbus beside it|ModbusSerialClient\(.*\)|[DMK]\d+|N:N|MOV|LD|Modbus|bussim|uPlot|ms|LANG|END|STOP|PLC|CPAVL|pymodbus|retries|"
    r"JavaScript|English|absent_station|full|probe|bad|typical|errors|ride|cycle|dead|age|skip_after_failure|"
    r"modbus-rtu|COM\d|press\d|feeder\d?|oven\d?|position|running|zones|setpoint|"
    r"electrical noise|bursts?|link|x\b|1e-?\d+|\by\b"
)


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("sizing")
    found = {"standard": STANDARD}
    for name, scenario in (("ports", "nn_with_modbus"), ("noisy", "electrical_noise"), ("bursts", "bursts")):
        found[name] = folder / f"{name}.html"
        assert main(["size", scenario, "-o", str(found[name])]) == (1 if name == "bursts" else 0)
    return found


@pytest.fixture(scope="module")
def window() -> Iterator[Any]:
    with chromium() as found:
        yield found


def set_to(window: Any, values: dict[str, int]) -> None:
    window.execute_script(
        """for (const [id, value] of Object.entries(arguments[0])) {
          const input = document.getElementById(id);
          input.value = String(value);
          input.dispatchEvent(new Event('input'));
        }""",
        values,
    )


def settle(window: Any) -> None:
    """Wait until the charts are drawn."""
    window.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")


def figures(window: Any) -> dict[str, str]:
    """The shown figures by name, without remarks."""
    script = """return Object.fromEntries([...document.querySelectorAll('#tiles [data-figure]')].map(
      e => [e.dataset.figure, e.firstChild.textContent]))"""
    return dict(window.execute_script(script))


def number(text: str) -> float:
    return (
        0.0
        if "never" in text
        else float(
            re.sub(
                r"[^\d.e+-]", "", text.replace("at worst", "").replace(" while no other reply is lost", "")
            )
        )
    )


def test_two_hundred_settings_are_those_of_size_json(window: Any, capsys: pytest.CaptureFixture[str]) -> None:
    show(window, STANDARD)
    draw, seen = random.Random(1), 0
    units = [item["units"] for item in payload(STANDARD)["items"]]
    for stations, mode in draw.sample([(n, m) for n in range(2, 9) for m in range(5)], 25):
        capsys.readouterr()
        assert main(["size", "--stations", str(stations), "--mode", str(mode), "--json"]) == 0
        sizing = json.loads(capsys.readouterr().out)["links"]["link"]
        here = units[(stations - 2) * 5 + mode]
        set_to(window, {"stations": stations - 2, "mode": mode})
        for choice in draw.sample([each for each in sizing["pareto"] if each["D8180"] in here], 8):
            set_to(window, {"retries": choice["D8179"], "timeout": here.index(choice["D8180"])})
            shown = figures(window)
            pairs = (
                ("mean", choice["mean_ms"], 0.1),
                ("dead", choice["one_dead_ms"], 0.1),
                ("detect", choice["detect_ms"]["mean"], 0.1),
                ("detect_longest", choice["detect_ms"]["max"], 0.1),
            )
            for name, exact, step in pairs:
                assert number(shown[name]) == pytest.approx(math.ceil(exact / step - 1e-6) * step), name
            assert number(shown["ride"]) == math.floor(choice["ride_through_ms"])
            errors = choice["false_errors_per_year"]
            assert number(shown["errors"]) == (
                0 if errors < 1e-3 else float(a_year(errors, 1.0).replace(",", ""))
            )
            program = window.find_element("id", "program").text
            assert f"MOV K{choice['D8179']} D8179" in program
            assert f"MOV K{choice['D8180']} D8180" in program
            seen += 1
        assert f"MOV K{choice['D8180']} D8180" in program
    assert seen == 200


@pytest.mark.parametrize("name", NAMES)
def test_every_slider_moves_by_keys(pages: dict[str, Path], window: Any, name: str) -> None:
    from selenium.webdriver.common.keys import Keys

    show(window, pages[name])
    sliders = window.find_elements("css selector", "input[type=range]")
    assert len(sliders) == (5 if name == "standard" else 3)
    picture = "return [...document.querySelectorAll('canvas')].map(c => c.toDataURL()).join()"
    for slider in sliders:
        most, before = int(slider.get_attribute("max")), {}
        for key, place in (
            (Keys.HOME, 0),
            (Keys.ARROW_RIGHT, 1),
            (Keys.END, most),
            (Keys.ARROW_LEFT, most - 1),
        ):
            slider.send_keys(key)
            assert int(slider.get_attribute("value")) == place
            assert slider.get_attribute("aria-valuetext")
            shown = figures(window)
            text = window.find_element("id", "verdict").text
            assert (shown, text) != before
            before = (shown, text)
        settle(window)
        drawn = window.execute_script(picture)
        slider.send_keys(Keys.HOME)
        settle(window)
        assert window.execute_script(picture) != drawn


def test_the_recommended_setting_is_taken_by_the_keyboard(pages: dict[str, Path], window: Any) -> None:
    from selenium.webdriver.common.keys import Keys

    show(window, pages["noisy"])
    use = window.find_element("id", "use")
    verdict = window.find_element("id", "verdict")
    assert not use.is_enabled()
    set_to(window, {"retries": 0})
    assert "misses: false station errors: at most 1 a year, an interruption of the line of" in verdict.text
    assert "Recommended: D8179 = 4, D8180 = 5." in verdict.text
    use.send_keys(Keys.ENTER)
    assert "It is the recommended setting" in verdict.text
    assert "MOV K4 D8179" in window.find_element("id", "program").text


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("width", [400, 1280])
@pytest.mark.parametrize("lang", ["en", "zh"])
@pytest.mark.parametrize("name", NAMES)
def test_it_shows_everything_and_loads_nothing(
    pages: dict[str, Path], window: Any, name: str, lang: str, width: int, dark: bool
) -> None:
    window.get_log("browser"), window.get_log("performance")
    show(window, pages[name], width=width, dark=dark)
    window.find_element("css selector", f"[data-lang={lang}]").click()
    choices = window.execute_script("return document.querySelectorAll('#name option').length") or 1
    for choice in range(choices):
        if choices > 1:
            set_to(window, {"name": choice})
        settle(window)
        assert window.execute_script("return document.documentElement.scrollWidth <= innerWidth")
        drawn = window.execute_script(
            """return [...document.querySelectorAll('figure:not([hidden]) canvas')].map(canvas => {
              const {data} = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
              return new Set(new Uint32Array(data.buffer)).size;
            })"""
        )
        assert drawn
        assert min(drawn) > 10
        if lang == "zh":
            body = window.execute_script("return document.querySelector('main').innerText + document.title")
            left = LATIN.sub("", body)
            assert not re.findall(r"[A-Za-z]{2,}", left), body
    small = window.execute_script(
        """return [...document.querySelectorAll('main button, main input, main select')].filter(
          e => e.offsetParent && innerWidth < 500 && e.getBoundingClientRect().height < 44).length"""
    )
    assert small == 0
    assert broken_rules(window) == []
    assert window.get_log("browser") == []
    messages = [json.loads(entry["message"])["message"] for entry in window.get_log("performance")]
    asked = [m["params"]["request"]["url"] for m in messages if m["method"] == "Network.requestWillBeSent"]
    assert asked
    # What a browser shows before its first page is its own.
    assert [url for url in asked if not url.startswith(("file:", "data:", "chrome:"))] == []
    assert (
        window.execute_script("return document.documentElement.lang") == {"en": "en", "zh": "zh-Hans"}[lang]
    )


def test_the_answer_stays_in_sight_beside_every_slider_of_a_narrow_page(window: Any) -> None:
    show(window, STANDARD, width=400)
    for slider in window.find_elements("css selector", "input[type=range]"):
        window.execute_script("arguments[0].scrollIntoView({block: 'center'})", slider)
        top, bottom = window.execute_script(
            "const r = document.getElementById('strip').getBoundingClientRect(); return [r.top, r.bottom]"
        )
        assert 0 <= top < bottom <= 900
        assert bottom - top <= 130


@pytest.mark.parametrize("lang", ["en", "zh"])
@pytest.mark.parametrize("name", NAMES)
def test_it_prints_on_one_page(
    pages: dict[str, Path], window: Any, tmp_path: Path, name: str, lang: str
) -> None:
    show(window, pages[name])
    window.find_element("css selector", f"[data-lang={lang}]").click()
    choices = window.execute_script("return document.querySelectorAll('#name option').length") or 1
    for choice in range(choices):
        if choices > 1:
            set_to(window, {"name": choice})
        assert len(printed(window, tmp_path / "page.pdf")) == 1


def test_a_dot_of_the_trade_off_can_be_taken(window: Any) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    show(window, STANDARD)
    plot = window.find_element("css selector", "#trade .u-over")
    size, taken = plot.size, set()
    for x in range(10 - size["width"] // 2, size["width"] // 2, 12):
        for y in range(8 - size["height"] // 2, size["height"] // 2, 16):
            plot = window.find_element("css selector", "#trade .u-over")
            ActionChains(window, duration=0).move_to_element_with_offset(plot, x, y).click().perform()
            settle(window)
            taken.add(window.find_element("id", "retries").get_attribute("value"))
    assert len(taken) >= 9
