"""The readers, each with inputs to begin from and what is to hold of every input.

A check raises BussimError where the reader refuses an input in words; anything else that it raises is a fault.
"""

from __future__ import annotations

import contextlib
import io
import json
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import yaml

from bussim.cli import main
from bussim.engines.contract import RxChar
from bussim.engines.modbus.adu import Adu, Mode, encode_adu
from bussim.engines.modbus.framing import Framing
from bussim.engines.nn.frames import Frame, FrameReader, encode_data, encode_poll
from bussim.errors import BussimError
from bussim.export.formats import FORMATS, export_trace
from bussim.line.characters import CharFormat, LineTiming
from bussim.live.layout.file import parse_layout, to_text
from bussim.live.layout.value import ASSUMED
from bussim.live.recordings.frames import TraceFile
from bussim.live.recordings.open import open_recording
from bussim.live.sniff.line import find_line
from bussim.live.sniff.listener import Listener
from bussim.live.sniff.reading import Settings
from bussim.plc.program.program import Program
from bussim.plc.program.text.exports import listing
from bussim.results.collector import Collector
from bussim.results.store.load import load_run
from bussim.scenario.loader import examine
from bussim.site.diagnosis.diagnose import diagnose
from bussim.site.file import load as load_readout
from bussim.site.link import SiteLink
from bussim.site.readout import Readout
from bussim.trace.file import read_trace
from tests.checksums import crc_by_definition
from tests.engines.nn import independent
from tests.fuzz.mutations import changed, changed_value, text_of
from tests.plc.program.test_exports import JUMPS, LINK, START_STOP
from tests.site.examples import healthy
from tests.undrawn import undrawn

ROOT = Path(__file__).parents[2]
FILES = ROOT / "tests" / "live" / "recordings" / "files"
STORED = ROOT / "tests" / "results" / "stored"
LINE = LineTiming(9600, CharFormat(8, "N", 1))
Mutation = Callable[[Random, bytes, list[bytes]], bytes]


class Target(NamedTuple):
    """A reader: ``check`` raises nothing but BussimError for any bytes; ``mutated`` makes them of a seed."""

    seeds: Callable[[], list[bytes]]
    check: Callable[[bytes], object]
    mutated: Mutation = changed
    inputs: int = 10_000  # of each run of all targets


@contextlib.contextmanager
def stored(data: bytes, name: str) -> Iterator[Path]:
    """A file with these bytes in a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="bussim-fuzz-") as folder:
        path = Path(folder) / name
        path.write_bytes(data)
        yield path


# -- scenarios, readouts, layouts ------------------------------------------------------------------

_SCENARIOS = ("barcode_reader", "bad_parameter", "bursts", "cable_cut", "hmi_on_com2", "stepper_positioning")


def _scenario_seeds() -> list[bytes]:
    return [(ROOT / "scenarios" / f"{name}.yaml").read_bytes() for name in _SCENARIOS]


@cache
def _plain(seed: bytes) -> Any:
    return yaml.safe_load(seed)


def _yaml_mutated(random: Random, seed: bytes, seeds: list[bytes]) -> bytes:
    if random.random() < 0.1:
        return changed(
            random, seed, seeds, (b"&a ", b"*a", b"<<: ", b"!!python/name:os.system ", b"? ", b"- ")
        )
    try:
        return text_of(changed_value(random, _plain(seed)))
    except (yaml.YAMLError, ValueError, TypeError):  # an input that was kept as a fault
        return changed(random, seed, seeds)


def _scenario(data: bytes) -> None:
    found = examine("x.yaml", source=io.BytesIO(data))
    assert (found.scenario is None) == bool(found.errors)
    assert all(problem.message and problem.line >= 0 for problem in found.errors + found.warnings)
    found.get()


def _readout_seeds() -> list[bytes]:
    return [yaml.safe_dump(healthy(slaves), sort_keys=False).encode() for slaves in (1, 2)]


def _readout(data: bytes) -> None:
    """What can be read is diagnosed, too."""
    with stored(data, "x.yaml") as path:
        noted = load_readout(path)
    if isinstance(noted, Readout):
        diagnose(noted, SiteLink.of(noted))


# -- programs --------------------------------------------------------------------------------------

_WORDS = tuple(
    b"LD AND OUT MPS MPP MRD CJ P0 K5 D8176 T0 C235 H1F K4M0 D0Z0 FOR NEXT STL RET S20 END".split()
)


def _program_seeds() -> list[bytes]:
    files = sorted((ROOT / "scenarios" / "programs").glob("*.il"), key=lambda path: path.stat().st_size)
    return [path.read_bytes() for path in files[:5]]


def _export_seeds() -> list[bytes]:
    seeds = []
    for rows in (START_STOP, LINK, JUMPS):
        for mark in ("\t", ",", ";"):
            heading = mark.join(f'"{word}"' for word in ("Step No.", "Instruction", "I/O", "Comment"))
            cells = [mark.join(f'"{cell}"' for cell in row) for row in rows]
            seeds.append("\n".join((heading, *cells)).encode())
    return [*seeds, b'"Device","Comment"\n"X0","start"\n"D10","pressure"\n']


def _program(data: bytes) -> None:
    Program.parse(data.decode(errors="replace"), "x.il", skips=len(data) % 2 == 0)


def _export(data: bytes) -> None:
    found = listing(data.decode(errors="replace"))
    if found.comments is None:
        Program.parse(found.text, "x.csv")


def _program_mutated(random: Random, seed: bytes, seeds: list[bytes]) -> bytes:
    return changed(random, seed, seeds, [word + end for word in _WORDS for end in (b" ", b"\n", b"P ")])


# -- folders of runs -------------------------------------------------------------------------------


_STORED = ("barcode_reader", "interlock", "nn_with_modbus")


def _summary_seeds() -> list[bytes]:
    runs = [STORED / name for name in _STORED]
    return [
        text_of([json.loads((run / f"{name}.json").read_bytes()) for name in ("summary", "histograms")])
        for run in runs
    ]


def _json_mutated(random: Random, seed: bytes, seeds: list[bytes]) -> bytes:
    if random.random() < 0.2:
        return changed(random, seed, seeds, (b"NaN", b"Infinity", b"null", b"1e999"))
    try:
        return text_of(changed_value(random, json.loads(seed)))
    except (ValueError, RecursionError):
        return changed(random, seed, seeds)


def _write_summary(data: bytes, folder: Path) -> None:
    """Make the files of a summary and histograms in a list."""
    try:
        parts = [text_of(part) for part in json.loads(data)]
    except (ValueError, TypeError, RecursionError):
        parts = [data]
    for name, part in zip(("summary.json", "histograms.json"), (*parts, data, data)[:2], strict=True):
        (folder / name).write_bytes(part)


def _summary(data: bytes) -> None:
    """A summary and histograms, in a list: what is read is shown, too."""
    from rich.console import Console

    from bussim.results.text.run import show_result

    with tempfile.TemporaryDirectory(prefix="bussim-fuzz-") as folder:
        _write_summary(data, Path(folder))
        record = load_run(Path(folder))
        out = io.StringIO()
        show_result(Console(file=out, width=100), record, {})
        assert "\x1b[31m" not in out.getvalue()


def _trace_seeds() -> list[bytes]:
    """The header and lines of every type, few of each."""
    seeds = []
    for name in _STORED:
        header, *lines = (STORED / name / "trace.jsonl").read_bytes().splitlines()
        kinds: dict[str, list[bytes]] = {}
        for line in lines:
            kinds.setdefault(json.loads(line)["type"], []).append(line)
        seeds.append(b"\n".join((header, *(line for kind in kinds.values() for line in kind[:3]))))
    return seeds


def _trace_mutated(random: Random, seed: bytes, seeds: list[bytes]) -> bytes:
    lines = seed.split(b"\n")
    at = random.randrange(len(lines)) if random.random() < 0.7 else 0
    lines[at] = _json_mutated(random, lines[at], seeds)
    return b"\n".join(lines) if random.random() < 0.9 else changed(random, b"\n".join(lines), seeds)


def _trace(data: bytes) -> None:
    """Every record is read, and one export is made."""
    with stored(data, "trace.jsonl") as path:
        trace = read_trace(path)
        for _ in trace:
            pass
        fmt = ("pcapng", "vcd", "perfetto", "csv", "sr")[len(data) % 5]
        export_trace(trace, path.with_name(f"x{FORMATS[fmt].ending}"), fmt)


_TRACED = ("report", "timeline", "export", "sniff", "fit")


def _commands(data: bytes) -> None:
    """A command ends with a code of its own whatever is in a run's folder; its pictures are not drawn."""
    name = next((name for name in _STORED if name.encode() in data[:4000]), _STORED[-1])
    with tempfile.TemporaryDirectory(prefix="bussim-fuzz-") as place, undrawn():
        folder = Path(place) / "run"
        shutil.copytree(STORED / name, folder)
        if data[:1] == b"[":
            _write_summary(data, folder)
        else:
            (folder / "trace.jsonl").write_bytes(data)
        word = (*_TRACED, "plot")[len(data) % 6] if data[:1] == b"[" else _TRACED[len(data) % 5]
        more = {
            "report": ["-o", f"{place}/x.html"],
            "export": ["--to", "pcapng"],
            "fit": ["-o", f"{place}/x.yaml"],
        }
        out, said = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(said):
            code = main([word, str(folder), *more.get(word, [])])
        assert code in (0, 1, 2)
        assert (code == 0) or said.getvalue().strip()
        assert "\x1b[31m" not in out.getvalue() + said.getvalue()


# -- recordings ------------------------------------------------------------------------------------


def _text_seeds() -> list[bytes]:
    names = sorted(path.name for path in FILES.glob("*.txt"))
    lines = [(FILES / name).read_bytes().split(b"\n")[:10] for name in names if name != "text_utf16.txt"]
    table = b"Time [s],Value,Parity Error,Framing Error\n0.1,'a',,\n0.2,0x03,,\n0.3,'1',,Error"
    return [table, "0.1 01 03\n0.2 02".encode("utf-16"), *map(b"\n".join, lines)]


def _packet_seeds() -> list[bytes]:
    return [(FILES / name).read_bytes()[:700] for name in ("rtu.pcapng", "classic.pcap", "rtac.pcap")]


def _session(entries: dict[str, bytes]) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as zipped:
        for name, content in entries.items():
            zipped.writestr(name, content)
    return file.getvalue()


def _session_seeds() -> list[bytes]:
    """Short sessions: an RTU request at ten samples a bit, on one of two channels."""
    request = encode_adu(Mode.RTU, 1, b"\x03\x00\x00\x00\x01").chars
    bits = "1" * 40 + "".join(f"0{value:08b}"[0] + f"{value:08b}"[::-1] + "1" for value in request) + "1" * 40
    samples = bytes(1 + 2 * int(bit) for bit in bits for _ in range(10))
    info = "[device 1]\ncapturefile=logic-1\ntotal probes=2\nsamplerate={}\nprobe1=A\nprobe2=B\nunitsize=1\n"
    rates = ("96 kHz", "96000", "192 kHz")
    return [
        _session({"version": b"2", "metadata": info.format(rate).encode(), "logic-1-1": samples})
        for rate in rates
    ]


def _session_mutated(random: Random, seed: bytes, seeds: list[bytes]) -> bytes:
    if random.random() < 0.3:
        return changed(random, seed, seeds)
    try:
        with zipfile.ZipFile(io.BytesIO(seed)) as zipped:
            entries = {name: zipped.read(name) for name in zipped.namelist()}
    except (zipfile.BadZipFile, NotImplementedError, OSError, ValueError, EOFError):
        return changed(random, seed, seeds)
    name = random.choice(list(entries))
    words = (
        b"samplerate=1 THz\n",
        b"samplerate=0\n",
        b"unitsize=8\n",
        b"unitsize=0\n",
        b"probe9=C\n",
        b"logic-2-1",
    )
    entries[name] = changed(random, entries[name], [*entries.values()], words)
    return _session(entries)


def _recording(name: str) -> Callable[[bytes], None]:
    def check(data: bytes) -> None:
        with stored(data, name) as path:
            source = open_recording(path)
            try:
                found = find_line(source, Settings(), 0)
                if isinstance(source, TraceFile):
                    return
                reading, wires = found.reading, max(len(found.reading.setup.channels), source.wires)
                listener = None
                if reading.protocol is not None:
                    timing = reading.setup.timing
                    listener = Listener("b", timing, Collector(), reading.protocol, begin=None, wires=wires)
                for chars, wire, _ in source.chunks(reading.setup):
                    assert all(start <= end for _, start, end in chars)
                    if listener is not None:
                        listener.chars(chars, wire)
                if listener is not None:
                    listener.close(source.end())
                    listener.totals(listener.last)
            finally:
                close = getattr(source, "close", None)
                if close is not None:
                    close()

    return check


# -- readers of characters -------------------------------------------------------------------------


def _adu_seeds(mode: Mode) -> Callable[[], list[bytes]]:
    pdus = (b"\x03\x00\x00\x00\x01", b"\x10\x00\x64\x00\x02\x04\x00\x01\x00\x02", b"\x83\x02", b"\x11")
    return lambda: [encode_adu(mode, station, pdu).chars * 2 for station in (0, 1, 247) for pdu in pdus]


def _paused(data: bytes) -> Iterator[tuple[RxChar, int, int]]:
    """Characters with pauses and flaws that follow from the bytes themselves."""
    character, now = LINE.characters(1), 0
    draw = Random(data)
    for value in data:
        yield RxChar(value, draw.random() > 0.01, draw.random() > 0.01), now, now + character
        now += character + (draw.choice((1, 2, 5, 20)) * character if draw.random() < 0.06 else 0)


def _adus(mode: Mode) -> Callable[[bytes], None]:
    """What a reader takes for a frame has the right check, by another's arithmetic; none is longer than data."""

    def check(data: bytes) -> None:
        reader = (Framing.rtu(LINE) if mode is Mode.RTU else Framing.ascii()).reader()
        found = [reader.character(*timed) for timed in _paused(data)]
        for frame in (*found, reader.silence()):
            assert frame is None or len(frame.chars) <= len(data)
            if isinstance(frame, Adu) and mode is Mode.RTU:
                assert crc_by_definition(frame.chars) == 0  # as it is over a frame with its own check
            elif isinstance(frame, Adu):
                assert sum(bytes.fromhex(frame.chars[1:-2].decode())) % 256 == 0

    return check


def _link_seeds() -> list[bytes]:
    frames = (
        encode_poll(1, 2),
        encode_poll(7, 15),
        encode_data(1, 2, bytes(range(8))),
        encode_data(3, 0, bytes(24)),
    )
    return [frame.chars * 2 for frame in frames]


def _link_frames(data: bytes) -> None:
    """The reader and one that another wrote from the description make the same of it."""
    reader, chars, tick = FrameReader(), [], 0
    draw, verdicts, behind = Random(data), [], None
    for value in data:
        clean = draw.random() > 0.02
        chars.append((tick, value & 0x7F, clean))
        tick += 10 + (draw.choice((1, 19, 20, 25)) if draw.random() < 0.1 else 0)
    for first, value, clean in chars:
        if behind is not None and first - behind >= 20:
            verdicts.append(reader.quiet())
        verdicts.append(reader.character(RxChar(value, clean, clean), first))
        behind = first + 10
    verdicts.append(reader.quiet())
    kinds = ["frame" if isinstance(each, Frame) else "damage" for each in verdicts if each]
    assert kinds == [verdict[0] for verdict in independent.verdicts(chars, None)]


TARGETS: dict[str, Target] = {
    "scenario": Target(_scenario_seeds, _scenario, _yaml_mutated),
    "readout": Target(_readout_seeds, _readout, _yaml_mutated),
    "layout": Target(
        lambda: [to_text(ASSUMED, "layout").encode()],
        lambda data: parse_layout(data, "x.yaml"),
        _yaml_mutated,
    ),
    "program": Target(_program_seeds, _program, _program_mutated),
    "export": Target(_export_seeds, _export, _program_mutated),
    "summary": Target(_summary_seeds, _summary, _json_mutated),
    "trace": Target(_trace_seeds, _trace, _trace_mutated),
    "commands": Target(
        lambda: [*_summary_seeds(), *_trace_seeds()],
        _commands,
        lambda random, seed, seeds: (_json_mutated if seed[:1] == b"[" else _trace_mutated)(
            random, seed, seeds
        ),
        inputs=200,
    ),
    "text": Target(_text_seeds, _recording("x.txt")),
    "packets": Target(_packet_seeds, _recording("x.pcapng")),
    "sigrok": Target(_session_seeds, _recording("x.sr"), _session_mutated),
    "rtu": Target(_adu_seeds(Mode.RTU), _adus(Mode.RTU)),
    "ascii": Target(_adu_seeds(Mode.ASCII), _adus(Mode.ASCII)),
    "nn": Target(_link_seeds, _link_frames),
}


def refused(target: Target, data: bytes) -> bool:
    """Whether the reader refuses an input in words. Raises whatever is no such refusal."""
    try:
        target.check(data)
    except BussimError as error:
        assert str(error).strip(), "a refusal without a word"
        return True
    return False
