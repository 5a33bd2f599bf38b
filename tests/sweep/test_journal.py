from __future__ import annotations

from pathlib import Path

import pytest

from bussim.sweep.journal import Journal

ROWS = {number: {"link.scans": number, "mean": number / 7, "p99": None} for number in range(5)}


def filled(path: Path) -> bytes:
    journal = Journal(path)
    for number, row in ROWS.items():
        journal.append(number, row)
    journal.close()
    return path.read_bytes()


def test_what_was_appended_is_there_again(tmp_path: Path) -> None:
    filled(tmp_path / "j")
    journal = Journal(tmp_path / "j")
    assert journal.done == set(ROWS)
    assert dict(journal.entries()) == ROWS
    journal.append(3, {"link.scans": 99})  # the first one counts
    journal.append(7, {"link.scans": 7})
    assert dict(journal.entries()) == {**ROWS, 7: {"link.scans": 7}}
    journal.close()


def test_cut_off_at_any_byte_only_the_last_run_is_lost(tmp_path: Path) -> None:
    whole = filled(tmp_path / "j")
    ends = [index + 1 for index, byte in enumerate(whole) if byte == ord("\n")]
    for length in range(len(whole) + 1):
        (tmp_path / "j").write_bytes(whole[:length])
        journal = Journal(tmp_path / "j")
        kept = sum(end <= length for end in ends)
        assert journal.done == set(range(kept))
        for number in set(ROWS) - journal.done:
            journal.append(number, ROWS[number])
        journal.close()
        assert (tmp_path / "j").read_bytes() == whole


@pytest.mark.parametrize("damage", [b"\x00", b"\xff", b"\n"])
def test_a_damaged_line_is_a_missing_run(tmp_path: Path, damage: bytes) -> None:
    whole = filled(tmp_path / "j")
    lines = whole.splitlines(keepends=True)
    start = sum(map(len, lines[:2]))
    for index in range(start, start + len(lines[2]) - 1):
        (tmp_path / "j").write_bytes(whole[:index] + damage + whole[index + 1 :])
        journal = Journal(tmp_path / "j")
        assert journal.done == set(ROWS) - {2}
        journal.append(2, ROWS[2])
        assert dict(journal.entries()) == ROWS
        journal.close()
