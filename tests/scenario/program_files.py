"""A scenario whose PLCs have programs, and what is said of it."""

from __future__ import annotations

from pathlib import Path

from bussim.scenario.loader import examine

MASTER = "LD M8002\nMOV K0 D8176\nMOV K1 D8177\nMOV K2 D8178\nMOV K5 D8180\nSET M8179\nEND\n"


SLAVE = "LD M8002\nMOV K1 D8176\nSET M8179\nLD X0\nOUT M1064\nEND\n"


TEXT = """\
schema: 1
name: test
duration: 10 s
buses:
  - {name: link, nn: true}
plcs:
  - name: one
    ports: {COM4: {bus: link}}
    program: one.il
  - name: two
    ports: {COM4: {bus: link}}
    program: two.il
    inputs: {X0: {square: 500 ms}}
observe: [one.M1064]
latency:
  - {from: two.X0, to: one.M1064, edge: rising}
"""


def folder(path: Path, text: str = TEXT, **files: str) -> Path:
    """A scenario and its programs on disk."""
    for name, content in {"one.il": MASTER, "two.il": SLAVE, **files}.items():
        (path / name.replace("__", ".")).write_text(content, encoding="utf-8")
    (path / "x.yaml").write_text(text, encoding="utf-8")
    return path / "x.yaml"


def problems(path: Path, text: str = TEXT, **files: str) -> list[str]:
    return [str(problem) for problem in examine(folder(path, text, **files)).errors]


def warnings(path: Path, text: str = TEXT, **files: str) -> list[str]:
    return [str(problem) for problem in examine(folder(path, text, **files)).warnings]


def shown(found: list[str], path: Path) -> list[str]:
    return [text.replace(f"{path}/", "") for text in found]
