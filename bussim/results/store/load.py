"""Reads the folder of a finished run back."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bussim.errors import UsageError
from bussim.files import INCOMPLETE, last_byte, plain, reading
from bussim.results.run_record import RunRecord
from bussim.results.store.folder import HISTOGRAMS, SUFFIX, SUMMARY
from bussim.results.store.in_memory import frame
from bussim.results.store.rows import FORMS, Form
from bussim.results.store.safe_names import from_cell
from bussim.results.store.tables import BYTES, FLAG, FORMATS, TEXT, Kind, import_pyarrow
from bussim.results.summary import SCHEMA
from bussim.results.summary.schema import check_summary
from bussim.trace.file import TRACE, Trace, read_trace, strict_json
from bussim.trace.records import Record, ScanRecord
from bussim.wording import visible

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
    with reading(folder):
        if not folder.is_dir():
            part = folder.with_name(folder.name + SUFFIX)
            hint = f"; {part} is a run that was not finished" if folder.name and part.is_dir() else ""
            what = "is a file, not the folder of a run" if folder.exists() else "does not exist"
            raise UsageError(f"{folder} {what}{hint}")
        if (folder / INCOMPLETE).is_file():
            raise UsageError(
                f"{folder} is incomplete: its run was stopped before it had finished; run it again"
            )
        if not (folder / SUMMARY).is_file():
            runs = sorted(path.parent.name for path in folder.glob(f"*/{SUMMARY}"))
            hint = f"; folders of runs in it: {', '.join(runs[:5])}" if runs else ""
            raise UsageError(f"{folder} is not the folder of a run: it has no {SUMMARY}{hint}")
    summary = _read_json(folder / SUMMARY)
    _check_schema(folder / SUMMARY, summary)
    try:
        check_summary(summary, "")
    except ValueError as error:
        raise UsageError(f"{folder / SUMMARY} is damaged, run it again: {error}") from error
    for link in summary["links"].values():
        for pair, old in link.get("stale_ms", {}).items():  # of an earlier version but the total
            link["stale_ms"][pair] = old if isinstance(old, dict) else {"total": old, "longest": None}
    histograms = _read_json(folder / HISTOGRAMS)
    _check_schema(folder / HISTOGRAMS, histograms)
    try:
        return RunRecord.from_json(summary, histograms)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        reason = f"{type(error).__name__}: {error}"
        raise UsageError(f"{folder / HISTOGRAMS} is damaged, run it again ({reason})") from error


class FolderRows:
    """The rows in a run's folder, read when asked for. UsageError names what the run did not keep."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def table(self, kind: type[Record]) -> pd.DataFrame:
        """The table of a type of record. Raises UsageError if the run did not keep it."""
        form = FORMS[kind]
        path = self._file(form)
        if path is not None:
            return _load_table(path, form.columns.kinds)
        if form.always or self._file(FORMS[ScanRecord]) is None:
            why = _NO_TRACE if form.traced else _NO_ROWS
            raise UsageError(f"{self._folder} has no {form.stem}.csv or {form.stem}.parquet: {why}")
        return frame(
            [[] for _ in form.columns.kinds], form.columns.kinds
        )  # the run kept rows, but had none of these

    def trace(self) -> list[dict[str, Any]]:
        """The lines of ``trace.jsonl``."""
        path = self._folder / TRACE
        try:
            with plain(path).open(encoding="utf-8-sig") as lines:
                return [strict_json(line) for line in lines]
        except FileNotFoundError:
            raise UsageError(f"{self._folder} has no {TRACE}: {_NO_TRACE}") from None
        except (OSError, RecursionError, ValueError) as error:
            raise UsageError(f"{path} cannot be read: {error}") from error

    def open_trace(self) -> Trace:
        """The trace, whose records are read as they are asked for."""
        return read_trace(self._folder)

    def _file(self, form: Form) -> Path | None:
        paths = (self._folder / f"{form.stem}.{fmt}" for fmt in FORMATS)
        return next((path for path in paths if path.is_file()), None)


def _load_table(path: Path, kinds: Mapping[str, Kind]) -> pd.DataFrame:
    """A table whose columns are those of ``kinds``: others are left out, what may be missing is none.

    So a table of an earlier or a later version is read, too.
    """
    errors: tuple[type[Exception], ...] = (ArithmeticError, OSError, TypeError, ValueError)
    if path.suffix != ".csv":
        errors += (import_pyarrow()[0].ArrowException,)
    try:
        return _read_table(path, kinds)
    except errors as error:
        raise UsageError(f"{path} cannot be read: {error}") from error


def _read_table(path: Path, kinds: Mapping[str, Kind]) -> pd.DataFrame:
    import pandas as pd

    if path.suffix == ".csv":
        if last_byte(path) not in b"\r\n":
            raise ValueError("its last line is cut off")
        table = pd.read_csv(
            path,
            # Flags are 0 and 1 there, which pandas reads as numbers only.
            dtype={name: "int64" if kind is FLAG else kind.pandas for name, kind in kinds.items()},
            keep_default_na=False,
            # Only an empty number is a missing one; a bus may be called "NA".
            na_values={name: [""] for name, kind in kinds.items() if kind not in (TEXT, BYTES)},
        )
    else:
        with plain(path).open("rb") as file:
            table = pd.read_parquet(file)
    if not table.index.equals(pd.RangeIndex(len(table))):  # a column was taken for the names of rows
        raise ValueError("its rows have more columns than its heading")
    missing = [name for name in kinds if name not in table.columns]
    # An earlier version lacks columns, a later one has others; both at once are renamed ones.
    renamed = missing and not kinds.keys() >= {*table.columns}
    if renamed or any(not kinds[name].may_miss for name in missing):
        found, wanted = ", ".join(map(str, table.columns)), ", ".join(kinds)
        raise UsageError(f"{path} has the columns {found}; those of such a table are {wanted}")
    for name in missing:
        table[name] = "" if kinds[name] in (TEXT, BYTES) else None
    if path.suffix == ".csv":
        for name in (name for name, kind in kinds.items() if kind is TEXT):
            table[name] = table[name].map(from_cell)
        if "code" in kinds.keys() - missing:
            table["code"] = table["code"].str.zfill(2)  # which a spreadsheet has taken for a number
    for name in (name for name, kind in kinds.items() if kind is FLAG):
        if table[name].dtype.kind not in "biu":  # the text "False" is true for pandas
            raise ValueError(f"its column {name} has {table[name].dtype}, no flags")
    table = table[list(kinds)].astype({name: kind.pandas for name, kind in kinds.items()})
    for name, kind in kinds.items():
        if kind.decimals and table[name].abs().max() == float("inf"):
            raise ValueError(f"its column {name} has an infinite number")
    return table


def _read_json(path: Path) -> dict[str, Any]:
    try:
        size = plain(path).stat().st_size
        if size > _LARGEST:
            raise UsageError(f"{path} has {size:,} bytes, more than any run writes ({_LARGEST:,})")
        data = _visible(strict_json(path.read_text(encoding="utf-8-sig")))
    except FileNotFoundError:
        raise UsageError(f"{path} is missing: {path.parent} is not the whole folder of a run") from None
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path} is not JSON: {error}") from error
    if not isinstance(data, dict):
        raise UsageError(f"{path} is not a file of bussim: it holds a {type(data).__name__}, not an object")
    return data


def _visible(data: Any) -> Any:
    """Plain data whose texts a terminal does not obey."""
    if isinstance(data, dict):
        return {visible(name): _visible(each) for name, each in data.items()}
    if isinstance(data, list):
        return [_visible(each) for each in data]
    return visible(data) if isinstance(data, str) else data


def _check_schema(path: Path, data: dict[str, Any]) -> None:
    schema = data.get("schema")
    if type(schema) is not int or schema < 1:
        raise UsageError(f"{path} is not a file of bussim: schema is {schema!r}")
    if schema > SCHEMA:
        writer = data.get("bussim", "a newer version")
        raise UsageError(
            f"{path} has schema {schema}, written by bussim {writer}; this one reads up to {SCHEMA}; "
            "update bussim"
        )
