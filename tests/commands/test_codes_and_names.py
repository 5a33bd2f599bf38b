"""In every output codes stand with their meaning and as codes, and names as they were given."""

from __future__ import annotations

import html
import re
from pathlib import Path

import pytest

from bussim.cli import main
from tests.undrawn import undrawn

LINE = """\
schema: 1
name: main_line with_names
duration: 2 s
seed: 73091
buses:
  - {name: n_link, nn: true}
  - {name: m_bus, baud: 19200, format: 8N1}
plcs:
  - name: main_plc
    nn: {bus: n_link, station: 0, slaves: 1, retries: 0}
    ports: {COM2: {bus: m_bus, protocol: modbus-rtu-slave, station: 9}, COM4: {bus: m_bus, protocol: modbus-rtu-master}}
    polls:
      - {name: far_off, port: COM4, station: 1, function: 3, address: 9999, count: 2, to: D400, every: 20 ms}
      - {name: no_one, port: COM4, station: 7, function: 3, address: 0, count: 2, to: D410, every: 500 ms}
  - {name: sub_plc, nn: {bus: n_link, station: 1}}
devices:
  - {name: big_drive, model: map, bus: m_bus, station: 1, registers: [{address: 0, count: 4, value: 0}]}
noise:
  - {bus: n_link, ber: 2e-4}
faults:
  - {at: 1 s, for: 300 ms, power_off: sub_plc}
"""
NAMES = ("main_line", "n_link", "m_bus", "main_plc", "sub_plc", "far_off", "no_one", "big_drive")
#: What may stand behind a code in words, by how the code stands there.
WORDS = {
    r"\b(01|04) [\d,]+×": r"\((no reply within the timeout|a damaged reply)",
    r"(?<!it responds with )exception 02|\b02 [\d,]+×": r"\((illegal address|address)",
    r"\b09 [\d,]+×": r"\(no response in time\)",
}


@pytest.fixture(scope="module")
def outputs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What each command prints and writes about the line, by command."""
    folder = tmp_path_factory.mktemp("codes")
    found = {}
    with pytest.MonkeyPatch.context() as patch, undrawn(), pytest.MonkeyPatch.context() as columns:
        patch.chdir(folder)
        columns.setenv("COLUMNS", "300")
        Path("line.yaml").write_text(LINE, encoding="utf-8")
        for name, command in {
            "run": ["run", "line.yaml", "--trace", "--out", "one"],
            "again": ["run", "line.yaml", "--seed", "80632", "--out", "two"],
            "report": ["report", "one", "-o", "one.html"],
            "compare": ["report", "one", "two", "-o", "both.html"],
            "sweep": ["sweep", "line.yaml", "--vary", "seed=73091,80632"],
            "timeline": ["timeline", "one", "--bus", "n_link", "-o", "one.svg"],
        }.items():
            printed = _printed(command)
            page = Path(printed.strip())
            if page.suffix == ".html":
                text = re.sub(r"<(style|script)\b.*?</\1>", "", page.read_text("utf-8"), flags=re.DOTALL)
                printed = html.unescape(re.sub(r"<[^>]+>", " ", re.sub(r"</t[dh]>", " | ", text)))
            found[name] = printed
    return found


def _printed(command: list[str]) -> str:
    import contextlib
    import io

    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert main(command) == 0
    return out.getvalue()


OUTPUTS = ("run", "report", "compare", "sweep", "timeline")


@pytest.mark.parametrize("name", OUTPUTS)
def test_codes_stand_with_their_meaning(name: str, outputs: dict[str, str]) -> None:
    for code, words in WORDS.items():
        for found in re.finditer(code, outputs[name]):
            following = outputs[name][found.end() : found.end() + 40]
            assert re.match(rf" ?{words}", following), found.group() + following


def test_each_kind_of_code_occurs(outputs: dict[str, str]) -> None:
    for kind in (
        r"01 [\d,]+× \(no reply",
        r"04 [\d,]+× \(a damaged",
        r"02 [\d,]+× \(illegal",
        r"09 [\d,]+× \(no resp",
    ):
        assert re.search(kind, outputs["run"]), kind
    assert "exception 02 (illegal address)" in outputs["report"]
    assert "port error 09 (no response in time; yy of D8063 = 7xyy)" in outputs["compare"]
    assert re.search(r"codes +01: no reply within the timeout; 04: a damaged reply", outputs["run"])
    assert "01: no reply within the timeout; 04: a damaged reply" in outputs["report"]


@pytest.mark.parametrize("name", OUTPUTS)
def test_codes_seeds_and_rates_are_not_written_like_quantities(name: str, outputs: dict[str, str]) -> None:
    assert re.findall(r"\b(7,[0-9]0[0-9]|73,091|80,632|19,200|8,063|9,999)\b", outputs[name]) == []
    assert ("73091" in outputs[name]) == (name != "timeline")


@pytest.mark.parametrize("name", OUTPUTS)
def test_names_keep_their_underscores(name: str, outputs: dict[str, str]) -> None:
    assert re.findall("|".join(rf"\b{known.replace('_', '[ -]?')}\b" for known in NAMES), outputs[name]) == []
    if name in ("run", "report"):
        assert [known for known in NAMES if known not in outputs[name]] == []


def test_what_rounds_to_nothing_is_no_difference(outputs: dict[str, str]) -> None:
    assert "≠" in outputs["compare"]
    assert re.findall(r"≠ *[-+−]?0\.0 ?%|≠ *[-+−]0(?!\.)", outputs["compare"]) == []
