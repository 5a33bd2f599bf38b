"""Check names what programs exchange and the refresh mode does not share."""

from __future__ import annotations

from pathlib import Path

import pytest

from .test_programs import MASTER, SLAVE, warnings


@pytest.mark.parametrize(
    ("one", "two", "named"),
    [
        ("LD M8000\nMOV K5 D8", "LD M8000\nMOV D8 K4Y0", [("one", "MOV writes D8"), ("two", "MOV takes D8")]),
        (
            "LD M8000\nBMOV D300 D4 K8",
            "LD>= D11 K3\nOUT Y0",
            [("one", "BMOV writes D11"), ("two", "LD>= takes D11")],
        ),
        ("LD M8000\nMOV K5 D7", "LD M8000\nMOV D7 K4Y0", []),  # shared
        ("LD M8000\nMOV K5 D8\nMOV D8 D300", "LD M8000\nMOV D8 K4Y0", []),  # its own
        ("LD M8000\nMOV K5 D8", "LD M8000\nFMOV K0 D0 K200\nMOV D8 K4Y0", []),  # cleared by both
        ("LD M8000\nMOV K5 D8", "LD M8000\nMOV D9 K4Y0", []),
        ("LD M8000\nMOV K5 D40", "LD M8000\nMOV D40 K4Y0", []),  # in the block of the station that takes it
        ("LD M8000\nMOV K5 D300", "LD M8000\nMOV D300 K4Y0", []),
    ],
)
def test_check_names_words_that_one_station_writes_another_takes_and_the_mode_does_not_share(
    tmp_path: Path, one: str, two: str, named: list[tuple[str, str]]
) -> None:
    programs = {"one.il": MASTER.replace("END", f"{one}\nEND"), "two.il": SLAVE.replace("END", f"{two}\nEND")}
    found = [text for text in warnings(tmp_path, **programs) if "does not share: it is not sent" in text]
    assert [text.split(": ")[1] for text in found] == [plc for plc, _ in named]
    for text, (_, does) in zip(found, named, strict=True):
        assert f"{does}, which refresh mode 2 does not share" in text


def test_check_names_what_the_refresh_mode_does_not_share(tmp_path: Path) -> None:
    rungs = "LDI M8184\nAND M1064\nOUT Y0\nLDI M8184\nMOV D32 D101\nOUT M1032\nOUT M1500\nOUT M1040\nLD M1040\nOUT Y1\nEND"
    for mode, devices in (("K0", ["M1064", "M1032 at line 12"]), ("K1", ["M1032"]), ("K2", [])):
        program = MASTER.replace("K2 D8178", f"{mode} D8178").replace("END", rungs)
        found = [text for text in warnings(tmp_path, **{"one.il": program}) if "one.il" in text]
        assert len(found) == bool(devices)
        assert all(device in found[0] for device in devices)
        assert all(f"which refresh mode {mode[1]} does not share: it is not sent" in text for text in found)
