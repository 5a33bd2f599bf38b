"""Recordings of lines whose truth is known: what sniff must find in each."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.live.recordings.reading import attempts, ok, sniffed

FILES = Path(__file__).parent / "files"
KNOWN: dict[str, Any] = json.loads((FILES.parent / "truth.json").read_text(encoding="utf-8"))


def value(found: dict[str, Any], key: str) -> Any:
    match key:
        case "ok":
            return ok(found)
        case "attempts":
            return attempts(found)
        case "exception":
            return found["outcomes"].get("exception", 0)
        case "station_errors":
            return sum(found["link"]["station_errors"].values())
        case "channel":
            (channel,) = found["channels"]
            return channel
        case "channels":
            return len(found["channels"])
        case "warnings":
            return [each["code"] for each in found["warnings"]]
        case _:
            for part in key.split("."):
                found = found[part]
            return found


@pytest.mark.parametrize("name", KNOWN)
def test_what_is_known_of_a_recording_is_found(name: str) -> None:
    found = sniffed(FILES / name, *KNOWN[name]["options"])
    for key, low, *high in KNOWN[name]["known"]:
        known = value(found, key)
        if isinstance(known, list):
            assert low in known, key
        elif high:
            assert low <= known <= high[0], key
        else:
            assert known == low, key
