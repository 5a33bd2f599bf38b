"""RS: D8120 to D8129, M8121 to M8129 and M8161, as the FX communication manual has them."""

from __future__ import annotations

import io

import pytest

from bussim.scenario.loader import examine, loads
from bussim.scenario.model import Scenario
from tests.sim.build import run
from tests.sim.test_plc_cases import watched

TEXT = """
schema: 1
name: RS
duration: 1 s
seed: 1
buses: [{name: b, baud: 9600, format: 8N1}]
plcs:
  - name: p
    profile: fx2n
    scan: 5 ms
    ports: {COM3: {bus: b}}
    inputs: {X0: {times: [100 ms]}}
    program: |
      LD M8002
      MOV H0081 D8120
      NOP
      LD M8000
      OUT M8161
      RS D200 K4 D500 K6
      LDP X0
      MOV H2211 D200
      MOV H4433 D201
      MOV H55 D202
      MOV H66 D203
      SET M8122
      LD M8123
      BMOV D500 D600 K6
      INC D0
      RST M8123
      END
devices:
  - name: scale
    model: free
    bus: b
    says:
      - {text: "ABCDEF", at: 300 ms}
"""


def sent(scenario: Scenario) -> list[bytes]:
    done = run(scenario)
    return [bytes(frame.chars) for frame in done.record.frames if frame.sender.startswith("p")]


@pytest.mark.parametrize(
    ("change", "frame"),
    [
        ({}, b"\x11\x33\x55\x66"),  # 8-bit mode: the low bytes
        ({"OUT M8161": "OUT M0"}, b"\x11\x22\x33\x44"),  # 16-bit mode: low byte first
        ({"H0081": "H0181"}, b"\x02\x11\x33\x55\x66"),  # b8: the header, STX unless D8124 says else
        ({"H0081": "H0281"}, b"\x11\x33\x55\x66\x03"),  # b9: the terminator, ETX unless D8125 says else
        ({"H0081": "H0381", "NOP": "MOV K5 D8124"}, b"\x05\x11\x33\x55\x66\x03"),
        ({"H0081": "H0081", "NOP": "MOV K5 D8124"}, b"\x11\x33\x55\x66"),
        ({"fx2n": "pw10", "COM3": "COM2"}, b"\x11\x33\x55\x66"),  # fixed to COM2 (PW10 board manual)
    ],
)
def test_what_it_sends(change: dict[str, str], frame: bytes) -> None:
    text = TEXT
    for old, new in change.items():
        text = text.replace(old, new)
    assert sent(loads(text)) == [frame]


def test_what_it_receives_and_shows() -> None:
    names = "D600 D605 D606 D0 M8122 M8123 D8122 D8123"
    found = watched(TEXT, " ".join(f"p.{name}" for name in names.split()))
    values = {name: found[f"p.{name}"].values for name in names.split()}
    assert values["D600"][-1:] + values["D605"][-1:] == [ord("A"), ord("F")]
    assert values["D606"] == []
    assert values["D0"] == [1]  # once: the program resets M8123
    assert values["M8122"] == [1, 0]  # set by the program, reset once all has left
    assert values["M8123"] == [1, 0]
    assert values["D8122"][0] == 4
    assert max(values["D8123"]) == 6


def test_nothing_is_received_until_the_program_has_reset_the_flag() -> None:
    text = TEXT.replace("RST M8123", "NOP").replace("at: 300 ms", "at: 300 ms, every: 100 ms")
    found = watched(text, "p.M8123 p.D500")
    assert found["p.M8123"].values == [1]
    text = TEXT.replace("at: 300 ms", "at: 300 ms, every: 100 ms")
    assert watched(text, "p.D0")["p.D0"].values == [1, 2, 3, 4, 5, 6, 7]


def test_a_reception_that_stops_is_over_after_d8129() -> None:
    text = TEXT.replace('"ABCDEF"', '"ABC"').replace("NOP", "MOV K3 D8129").replace("RST M8123", "NOP")
    found = watched(text, "p.M8129 p.D8123")
    assert found["p.M8129"].values == [1]
    assert found["p.D8123"].values[-1] == 3
    # Three characters from 300 ms on, then 30 ms without any, seen at an END.
    assert 0.333 <= found["p.M8129"].ticks[0] / 72e6 <= 0.339


def messages(text: str) -> str:
    found = examine("x.yaml", source=io.BytesIO(text.encode()))
    return "\n".join(problem.message for problem in (*found.errors, *found.warnings))


def test_what_check_says() -> None:
    assert messages(TEXT) == ""
    assert "D8120, the format of RS, is 0): M8063 on, D8063 = 63" in messages(
        TEXT.replace("MOV H0081", "MOV K0")
    )
    assert "p.COM3 runs at 9600 8E1, b at 9600 8N1" in messages(TEXT.replace("H0081", "H0087"))
    keyed = messages(TEXT.replace("{bus: b}}", "{bus: b, protocol: free, timeout: 1 s}}"))
    assert "ports.COM3.protocol has no meaning: RS of p drives COM3" in keyed
    assert "RS drives COM3, but ports does not name its bus" in messages(TEXT.replace("COM3: ", "COM4: "))
    again = TEXT.replace("RS D200 K4 D500 K6", "RS D200 K4 D500 K6\n      RS D300 K1 D700 K1")
    assert "RS drives port COM3 while RS at line 19 does, which keeps it" in messages(again)
    linked = TEXT.replace("8N1}]", "8N1}, {name: l, nn: true}]").replace("{bus: b}}", "{bus: l}}")
    linked = linked.replace("inputs: {", "registers: {D8176: 1}\n    inputs: {")
    assert "RS drives COM3, which the link has: it does nothing" in messages(linked)
    # Without an RS its devices do nothing.
    assert "M8123 is for RS, which no program of the PLC has" in messages(
        TEXT.replace("RS D200 K4 D500 K6", "NOP")
    )


def test_the_second_of_two_is_refused_and_counted() -> None:
    again = TEXT.replace("RS D200 K4 D500 K6", "RS D200 K4 D500 K6\n      RS D300 K1 D700 K1")
    done = run(loads(again))
    assert any("two RS or RS2 are driven on COM3 at once" in text for text in done.totals.warnings)
    assert [len(frame.chars) for frame in done.record.frames if frame.sender == "p.COM3"] == [4]
