"""Reads the folder of a finished run back."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bussim.errors import UsageError
from bussim.results.run_record import RunRecord
from bussim.results.store.folder import HISTOGRAMS, MARKER, SUFFIX, SUMMARY
from bussim.results.store.names import from_cell
from bussim.results.store.rows import FORMS, Form
from bussim.results.store.tables import FORMATS, PANDAS_TYPES, import_pyarrow
from bussim.results.summary import SCHEMA
from bussim.trace.file import TRACE, Trace, read_trace
from bussim.trace.records import (
    AttemptRecord,
    DeviceValueRecord,
    FreeRecord,
    InputRecord,
    Record,
    ScanRecord,
    TransactionRecord,
)

if TYPE_CHECKING:
    import pandas as pd

#: No file of a run that is read whole is larger (bytes).
_LARGEST = 256 * 1024 * 1024
_NO_ROWS = "it was run without rows (--no-rows)"
_NO_TRACE = "it was run without a trace (--trace)"


def load_run(folder: Path) -> RunRecord:
    """The summary, histograms and notes of a run's folder.

    Raises UsageError if it is no such folder, is incomplete or damaged, or was written by a newer
    bussim with another schema.
    """
    if not folder.is_dir():
        part = folder.with_name(folder.name + SUFFIX)
        hint = f"; {part} is a run that was not finished" if folder.name and part.is_dir() else ""
        what = "is a file, not the folder of a run" if folder.exists() else "does not exist"
        raise UsageError(f"{folder} {what}{hint}")
    if (folder / MARKER).is_file():
        raise UsageError(f"{folder} is incomplete: its run was stopped before it had finished; run it again")
    if not (folder / SUMMARY).is_file():
        runs = sorted(path.parent.name for path in folder.glob(f"*/{SUMMARY}"))
        hint = f"; folders of runs in it: {', '.join(runs[:5])}" if runs else ""
        raise UsageError(f"{folder} is not the folder of a run: it has no {SUMMARY}{hint}")
    summary = _read_json(folder / SUMMARY)
    _check_schema(folder / SUMMARY, summary)
    histograms = _read_json(folder / HISTOGRAMS)
    _check_schema(folder / HISTOGRAMS, histograms)
    try:
        return RunRecord.from_json(summary, histograms)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        reason = f"{type(error).__name__}: {error}"
        raise UsageError(f"{folder / HISTOGRAMS} is damaged, run it again ({reason})") from error


class FolderRows:
    """The rows in a run's folder, read when asked for. UsageError tells what the run did not keep."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def link_scans(self) -> pd.DataFrame:
        """The table of link scans."""
        return self._table(ScanRecord, _NO_ROWS)

    def transactions(self) -> pd.DataFrame:
        """The table of Modbus transactions."""
        return self._table(TransactionRecord, _NO_ROWS)

    def free(self) -> pd.DataFrame:
        """The table of the free protocol."""
        return self._table(FreeRecord, _NO_ROWS)

    def values(self) -> pd.DataFrame:
        """The table of observed devices."""
        return self._table(DeviceValueRecord, _NO_ROWS)

    def inputs(self) -> pd.DataFrame:
        """The table of driven inputs."""
        return self._table(InputRecord, _NO_ROWS)

    def exchanges(self) -> pd.DataFrame:
        """The table of attempts."""
        return self._table(AttemptRecord, _NO_TRACE)

    def trace(self) -> list[dict[str, Any]]:
        """The lines of ``trace.jsonl``."""
        path = self._folder / TRACE
        try:
            with path.open(encoding="utf-8") as lines:
                return [json.loads(line) for line in lines]
        except FileNotFoundError:
            raise UsageError(f"{self._folder} has no {TRACE}: {_NO_TRACE}") from None
        except (OSError, ValueError) as error:
            raise UsageError(f"{path} cannot be read: {error}") from error

    def open_trace(self) -> Trace:
        """The trace, whose records are read as they are asked for."""
        return read_trace(self._folder)

    def _table(self, kind: type[Record], why_none: str) -> pd.DataFrame:
        form = FORMS[kind]
        path = self._file(form)
        if path is not None:
            return _load_table(path, form.columns)
        if form.always or self._file(FORMS[ScanRecord]) is None:
            stem = form.stem
            raise UsageError(f"{self._folder} has no {stem}.csv or {stem}.parquet: {why_none}")
        return _empty_table(form.columns)  # the run kept rows, but had none of these

    def _file(self, form: Form) -> Path | None:
        paths = (self._folder / f"{form.stem}.{fmt}" for fmt in FORMATS)
        return next((path for path in paths if path.is_file()), None)


def _empty_table(columns: dict[str, str]) -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame({name: pd.Series([], dtype=PANDAS_TYPES[kind]) for name, kind in columns.items()})


def _load_table(path: Path, columns: dict[str, str]) -> pd.DataFrame:
    import pandas as pd

    types = {name: PANDAS_TYPES[kind] for name, kind in columns.items()}
    try:
        if path.suffix == ".csv":
            # Flags are 0 and 1 there, which pandas reads as numbers only.
            written = {**types, **dict.fromkeys(_of_kind(columns, "flag"), "int64")}
            table = pd.read_csv(
                path, dtype=written, keep_default_na=False, na_values=_numbers_missing(columns)
            )
        else:
            import_pyarrow()
            table = pd.read_parquet(path)
        if list(table.columns) != list(columns):
            raise UsageError(f"{path} has the columns {', '.join(table.columns)}; not a table of bussim")
        if path.suffix == ".csv":
            for name in _of_kind(columns, "text"):
                table[name] = table[name].map(from_cell)
        return table.astype(types)
    except (OSError, ValueError) as error:
        raise UsageError(f"{path} cannot be read: {error}") from error


def _of_kind(columns: dict[str, str], wanted: str) -> list[str]:
    return [name for name, kind in columns.items() if kind == wanted]


def _numbers_missing(columns: dict[str, str]) -> dict[str, list[str]]:
    """Only an empty number is a missing one; a bus may be called "NA"."""
    return {name: [""] for name, kind in columns.items() if kind not in ("text", "bytes")}


def _read_json(path: Path) -> dict[str, Any]:
    try:
        size = path.stat().st_size
        if size > _LARGEST:
            raise UsageError(f"{path} has {size:,} bytes, more than any run writes ({_LARGEST:,})")
        data = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise UsageError(f"{path} is missing: {path.parent} is not the whole folder of a run") from None
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path} is not JSON: {error}") from error
    if not isinstance(data, dict):
        raise UsageError(f"{path} is not a file of bussim: it holds a {type(data).__name__}, not an object")
    return data


def _check_schema(path: Path, data: dict[str, Any]) -> None:
    schema = data.get("schema")
    if not isinstance(schema, int) or schema < 1:
        raise UsageError(f"{path} is not a file of bussim: schema is {schema!r}")
    if schema > SCHEMA:
        writer = data.get("bussim", "a newer version")
        raise UsageError(
            f"{path} has schema {schema}, written by bussim {writer}; this one reads up to {SCHEMA}; "
            "update bussim"
        )
