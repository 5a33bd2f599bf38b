"""A scenario without mistakes, to be changed in one place, and what the loader says then."""

from __future__ import annotations

from bussim.errors import ScenarioError
from bussim.scenario.loader import loads

BASE = """\
schema: 1
name: test
duration: 10 s
buses:
  - {name: link, nn: true}
plcs:
  - name: press1
    scan: 8 ms
    nn: {bus: link, port: COM4, station: 0, slaves: 2, timeout: 50 ms}
  - {name: press2, scan: 5 ms, nn: {bus: link, port: COM4, station: 1}}
  - {name: press3, scan: 5 ms, nn: {bus: link, port: COM4, station: 2}}
"""


def changed(old: str, new: str) -> str:
    """The sample with its first ``old`` replaced."""
    assert old in BASE
    return BASE.replace(old, new, 1)


def added(text: str) -> str:
    """The sample with lines after its last."""
    return BASE + text


def mistakes(text: str) -> list[str]:
    """Every message about a text, as the command line prints them; empty for a good scenario."""
    try:
        loads(text, "x.yaml")
    except ScenarioError as error:
        return [str(problem) for problem in error.problems]
    return []
