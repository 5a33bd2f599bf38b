"""Exports a trace to a file: the one way in, for the command and for Python."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bussim.errors import UsageError
from bussim.export.source import BusSurvey, Selection, Survey, survey
from bussim.trace.file import Trace
from bussim.wording import suggest

if TYPE_CHECKING:
    from bussim.export.lanes import Lanes

#: The formats, with the ending of their files.
ENDINGS: Final = {
    "pcapng": ".pcapng",
    "vcd": ".vcd",
    "sr": ".sr",
    "perfetto": ".json",
    "csv": ".csv",
    "parquet": ".parquet",
}
#: Default names of the files, without their endings.
STEMS: Final = {"perfetto": "perfetto", "csv": "frames", "parquet": "frames"}


@dataclass(frozen=True, slots=True)
class Exported:
    """What was written: how many frames (Perfetto: events) of which buses, and how to open it."""

    path: Path
    items: int
    buses: tuple[str, ...]
    hints: tuple[str, ...]


def export_trace(
    trace: Trace,
    path: Path,
    to: str,
    *,
    bus: str | None = None,
    start: int | None = None,
    stop: int | None = None,
    encapsulation: str = "serial",
) -> Exported:
    """Write a trace, or one bus and the window ``start <= tick < stop`` of it, in a format.

    ``to`` is one of :data:`ENDINGS`, ``encapsulation`` ("serial" or "udp") how pcapng wraps Modbus
    RTU. The file appears whole or not at all; an existing one is replaced. Raises UsageError where
    the request cannot be carried out: an unknown bus, nothing in the window, a file that cannot be
    written, a damaged trace.
    """
    if to not in ENDINGS:
        raise UsageError(f"no format {to!r}; {suggest(to, list(ENDINGS))}")
    selection = Selection(trace, bus, start, stop)
    header = trace.header
    seed = f", seed {header.seed}" if header.seed is not None else ""
    comment = f"{header.scenario}{seed}"
    if to == "perfetto":
        from bussim.export.perfetto import write_perfetto

        with _beside(path) as part:
            events = write_perfetto(part, selection, comment)
        return Exported(path, events, tuple(selection.buses), ("open it at https://ui.perfetto.dev",))
    found = survey(selection)
    with _beside(path) as part:
        hints = _write(part, to, selection, found, comment, encapsulation)
    return Exported(path, found.frames, tuple(found.buses), hints)


def _write(
    path: Path, to: str, selection: Selection, found: Survey, comment: str, encapsulation: str
) -> tuple[str, ...]:
    if to == "pcapng":
        from bussim.export.packets import how_to_open, write_pcapng

        write_pcapng(path, selection, found, comment, encapsulation)
        return tuple(how_to_open(found, encapsulation))
    if to in ("csv", "parquet"):
        from bussim.export.tables import write_table

        write_table(path, selection, found, to)
        return ()
    from bussim.export.lanes import Lanes

    lanes = Lanes(selection, found)
    if to == "vcd":
        from bussim.export.vcd import write_vcd

        write_vcd(path, lanes, comment)
    else:
        from bussim.export.sigrok import write_sigrok

        write_sigrok(path, lanes)
    return tuple(hint for bus in found.buses.values() for hint in _decoders(bus, lanes))


def _decoders(bus: BusSurvey, lanes: Lanes) -> Iterator[str]:
    lane = lanes.name_of(bus.name)
    yield f"PulseView: decoder UART, lane {lane}: {bus.timing.baud} {bus.timing.format}"
    if "modbus-rtu" in bus.protocols:
        yield (
            f"PulseView: for Modbus on {lane} give UART the answering station's lane as RX and the master's "
            "as TX, and stack Modbus on it"
        )


@contextmanager
def _beside(path: Path) -> Iterator[Path]:
    """A place beside the file, which becomes it if all goes well and is removed if not."""
    part = path.with_name(f"{path.name}.part")
    try:
        yield part
        part.replace(path)
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror or error}") from error
    finally:
        part.unlink(missing_ok=True)
