"""Readouts that tests write by hand."""

from pathlib import Path
from typing import Any

from bussim.scenario.yaml.dump import dumped
from bussim.site.file import load
from bussim.site.readout import Readout

PLACES = ("press", "feeder", "lift", "saw")


def healthy(slaves: int = 3) -> dict[str, Any]:
    """Four stations in mode 2 of which nothing is known to be wrong; a scan takes 66.6 ms."""
    stations = [
        {
            "place": place,
            "number": number,
            "state": "run",
            "lamps": {"SD": "flickers", "RD": "flickers"},
            "after": {
                "D8174": slaves, "D8201": 67, "D8202": 67,
                **{f"D{8203 + k}": 0 for k in range(slaves + 1)},
                **{f"D{8211 + k}": 0 for k in range(slaves + 1)},
                **{f"M{8183 + k}": "off" for k in range(slaves + 1)}, "M8191": "on",
            },
        }
        for number, place in enumerate(PLACES[: slaves + 1])
    ]  # fmt: skip
    settings = {"slaves": slaves, "mode": 2, "retries": 3, "timeout": "50 ms"}
    return {
        "schema": 1, "kind": "readout", "profile": "pw10", "settings": settings,
        "order": list(PLACES[: slaves + 1]), "watched": "20 min", "stations": stations,
    }  # fmt: skip


def seen(data: dict[str, Any], number: int, **registers: object) -> None:
    """Change what was read at a station."""
    data["stations"][number]["after"] |= registers


def readout(data: dict[str, Any], folder: Path) -> Readout:
    """The readout of plain data, by way of a file."""
    path = folder / "readout.yaml"
    path.write_text(dumped(data), encoding="utf-8")
    found = load(path)
    assert isinstance(found, Readout)
    return found
