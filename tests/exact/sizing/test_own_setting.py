"""A recommendation does not depend on the D8179 and D8180 that the link has, so that it can be kept."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bussim
from tests.selection import quick

NOISE = {
    "none": "[]",
    "ber": "[{bus: link, ber: 2.0e-5}]",
    "loss": "[{bus: link, station: s1, reply_loss: 0.001}]",
    "bursts": "[{bus: link, burst: {good: 10 s, bad: 20 ms, ber_bad: 0.01}}]",
}
DEAD = "[{power_off: s1, at: 0 s}]"


def sized(
    retries: int,
    d8180: int,
    *,
    reading: str,
    absent: str,
    noise: str,
    mode: int = 1,
    slaves: int = 2,
    dead: bool,
) -> object:
    """What is recommended to a link with this setting."""
    profile = f"{{base: pw10, attempts: {reading}, absent_station: {absent}}}"
    plcs = [
        f"  - {{name: s{n}, profile: {profile}, nn: {{bus: link, port: COM4, station: {n}}}}}\n"
        for n in range(1, slaves + 1)
    ]
    text = f"""schema: 1
name: own setting
duration: 10 s
buses: [{{name: link, nn: true}}]
plcs:
  - {{name: m, profile: {profile}, nn: {{bus: link, port: COM4, station: 0, slaves: {slaves}, mode: {mode},
     retries: {retries}, timeout: {10 * d8180} ms}}}}
{"".join(plcs)}noise: {NOISE[noise]}
faults: {DEAD if dead else "[]"}
"""
    return bussim.size(bussim.loads(text)).links["link"].to_json()


@pytest.mark.parametrize(
    ("setting", "reading"), quick(1, [((0, 5), "retries"), ((1, 225), "retries"), ((0, 5), "retries+1")])
)
def test_a_link_without_retries_or_with_the_longest_timeout(setting: tuple[int, int], reading: str) -> None:
    # Of attempts = 1 nothing tells the reading: no retries, or one of which D8179 = 1 is read as one attempt.
    line = {"reading": reading, "absent": "full", "noise": "ber", "dead": False}
    assert sized(*setting, **line) == sized(3, 10, **line)  # type: ignore[arg-type]


@pytest.mark.slow
@settings(deadline=None, max_examples=12)
@given(
    setting=st.tuples(st.integers(0, 10), st.integers(5, 225)),
    reading=st.sampled_from(["retries", "retries+1"]),
    absent=st.sampled_from(["full", "probe"]),
    noise=st.sampled_from([*NOISE]),
    mode=st.integers(0, 4),
    slaves=st.integers(1, 4),
    dead=st.booleans(),
)
def test_any_link(setting: tuple[int, int], **line: object) -> None:
    assert sized(*setting, **line) == sized(3, 10, **line)  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["nn_with_modbus", "electrical_noise", "bursts", "press_line"])
def test_built_in_scenarios_with_their_poll_lists(name: str) -> None:
    loaded = bussim.load(name)
    master = next(plc.name for plc in loaded.plcs if plc.link and plc.registers.get("D8176", 0) == 0)
    found = []
    for retries, timeout in ((0, "60 ms"), (7, "400 ms")):
        path = f"plcs.{master}.nn"
        sized_so = bussim.size(bussim.load(name, [f"{path}.retries={retries}", f"{path}.timeout={timeout}"]))
        form = sized_so.to_dict()
        found.append((form["links"], form.get("ports")))
    assert found[0] == found[1]
