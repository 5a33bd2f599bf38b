from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from bussim.export.tables import COLUMNS
from bussim.units import nanoseconds
from tests.export.samples import FEEDER, LINK, frame, link_frames, trace
from tests.export.samples import exported as export


def read(path: Path) -> pd.DataFrame:
    if path.suffix == ".parquet":
        return pd.read_parquet(path)
    return pd.read_csv(path, dtype={"bytes": str, "heard": str, "damaged_bits": str}, keep_default_na=False)


@pytest.mark.parametrize("to", ["csv", "parquet"])
def test_a_row_is_a_frame(tmp_path: Path, to: str) -> None:
    if to == "parquet":
        pytest.importorskip("pyarrow")
    frames = link_frames(40, damage=0.4)
    frames.append(frame(FEEDER, frames[-1].end, "feeder1", b"\x01", damaged_at={"a, b": (1, 5), "c": (7,)}))
    table = read(export(trace(*frames, buses=(LINK, FEEDER)), tmp_path / f"a.{to}", to))
    assert list(table.columns) == list(COLUMNS.kinds)
    assert len(table) == len(frames)
    for one, (_, row) in zip(frames, table.iterrows(), strict=True):
        assert (row["bus"], row["sender"], row["kind"], row["protocol"]) == (
            one.bus,
            one.sender,
            one.kind,
            one.protocol,
        )
        assert round(row["start_s"] * 1e9) == nanoseconds(one.start)
        assert round(row["end_s"] * 1e9) == nanoseconds(one.end)
        assert bytes.fromhex(row["bytes"]) == one.chars
        assert row["characters"] == len(one.chars)
        assert row["damaged_bits"] == " ".join(map(str, one.damaged_bits))
        assert (row["baud"], row["format"]) == (one.baud, one.format)
        assert not row["collided"]
        if not one.damaged_bits:
            assert row["heard"] == row["bytes"]
            assert row["wrong_characters"] == 0
        elif len(one.damaged_bits) == 1:
            assert row["wrong_characters"] > 0
    assert (row["damaged_at"], row["damaged_at_bits"]) == ("a, b; c", "1 5; 7")
    assert pd.isna(row["station"]) or row["station"] == ""
