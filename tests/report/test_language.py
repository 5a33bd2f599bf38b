"""The report in Chinese: no English word is left but names, commands and warnings."""

from __future__ import annotations

import html
import json
import re
from pathlib import Path

import pytest

import bussim
from bussim.errors import UsageError
from bussim.results.text.lines import fault_in_words
from bussim.scenario.provenance import classes
from bussim.words.language import shown, use_language
from bussim.words.origins import assumption_in_words, in_words

_NAMES = {
    *("COM", "CRC", "LRC", "JavaScript", "MOV", "SET", "RST", "OFF", "PLC", "STOP", "HMI", "Modbus", "xyy"),
    *("bussim", "uPlot", "absent", "station", "full", "probe", "END", "arrived", "left"),
}


def visible(page: str) -> str:
    """What a page shows without its script: neither commands nor the scenario, which is a file."""
    body = page[page.index("<main") : page.index('<script type="application/json"')]
    return html.unescape(
        re.sub(
            "<[^>]+>",
            " ",
            re.sub(r"<pre.*?</pre>|<section class=\"warnings\".*?</section>", "", body, flags=re.DOTALL),
        )
    )


@pytest.mark.parametrize(
    ("scenario", "duration"),
    [
        ("press_line", "30 s"),
        ("interlock", "3 s"),
        ("nn_with_modbus", "3 s"),
        ("barcode_reader", "5 s"),
        ("two_masters", "3 s"),
    ],
)
def test_no_english_word_is_left_but_names(scenario: str, duration: str, tmp_path: Path) -> None:
    loaded = bussim.load(scenario, [f"duration={duration}"])
    bussim.run(loaded, out=tmp_path / "run", trace=scenario == "press_line")
    page = bussim.report(tmp_path / "run", lang="zh").read_text(encoding="utf-8")
    own = {*re.findall("[A-Za-z]+", (tmp_path / "run" / "scenario.yaml").read_text(encoding="utf-8")), "run"}
    shown_text = re.sub(r"bussim run \S+ --trace --out NEW_DIR|bussim run … --trace", "", visible(page))
    assert {*re.findall("[A-Za-z]{3,}", shown_text)} - own - _NAMES == set()
    assert 'lang="zh-Hans"' in page
    payload = json.loads(page[page.index('id="payload">') + 13 :].partition("</script>")[0])
    for chart in payload["charts"]:
        assert re.search("[\u4e00-\u9fff]", chart["title"])
        assert re.search("[\u4e00-\u9fff]", chart["description"])
    assert payload["words"]["zh"]["chart_all"] == "显示全部"


def test_another_language_is_refused_before_the_page_is_written(tmp_path: Path) -> None:
    bussim.run(bussim.load("two_stations", ["duration=1 s"]), out=tmp_path / "run")
    with pytest.raises(UsageError, match="the language is 'de', allowed are en and zh"):
        bussim.report(tmp_path / "run", lang="de")
    assert not (tmp_path / "run" / "report.html").exists()


@pytest.mark.parametrize(
    ("text", "chinese"),
    [
        ("press2 without supply for 5 s", "press2 断电，持续 5 s"),
        ("press2 pauses for 3 ms inside frames for 2 s", "press2 在帧中间停顿 3 ms，持续 2 s"),
        ("press2 pauses for 3 ms inside frames", "press2 在帧中间停顿 3 ms"),
        ("press2 slow by 5 ms for 3 s", "press2 慢 5 ms，持续 3 s"),
        ("a in STOP", "a 处于 STOP"),
        ("something else for 3 s", "something else，持续 3 s"),
    ],
)
def test_faults_of_a_trace_are_known_by_their_texts(text: str, chinese: str) -> None:
    said = fault_in_words(text)
    assert said == text
    with use_language("zh"):
        assert shown(said) == chinese


def test_what_figures_rest_on_is_said_from_a_summary() -> None:
    text = "D8179 is read as retries+1 (assumed); read as retries: 9,000 false station errors a year instead of 200, a scan of 4 ms instead of 3 ms"
    said = assumption_in_words(text)
    assert said == text
    with use_language("zh"):
        assert shown(said) == (
            "D8179 理解为重复次数（假定）；若理解为总的尝试次数：每年误报站错误 9,000 次（原为 200）、链接扫描 4 ms（原为 3 ms）"
        )
    found = classes({"noise": "measured in a.sr", "frame lengths": "derived"}, ["mean_ms", "scans"])
    assert in_words(found)[0] == "measured in a.sr: noise"
    with use_language("zh"):
        assert shown(in_words(found))[:2] == ["实测的（a.sr）：干扰", "推导的：帧长"]
