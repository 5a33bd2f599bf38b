"""Where the data of a PLC's polls lie in its memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bussim.engines.modbus.pdu import READS
from bussim.plc.memory import BIT_RANGES, WORD_RANGES, Device
from bussim.plc.ports import cpavl
from bussim.scenario.resolve.members import Member
from bussim.scenario.resolve.port_configuration import FIRST_SPECIAL, PortConfiguration
from bussim.scenario.rules.links import blocks_of
from bussim.scenario.schema.draft import Entry
from bussim.scenario.schema.polls import PollIn, TransactionIn
from bussim.scenario.yaml.source_map import Path, Report

#: Devices that coils are read into and written from.
_COIL_LETTERS = "DMSY"


@dataclass(frozen=True, slots=True)
class Placed:
    """The PLC and the port that a poll belongs to, among all PLCs."""

    member: Member
    config: PortConfiguration
    members: Sequence[Member]


def check_registers(
    entry: Entry[TransactionIn], poll: PollIn, place: Placed, count: int, report: Report
) -> None:
    """Registers lie in D."""
    key, device = _operand(entry, poll, report)
    if device is None:
        return
    if device.letter != "D":
        report.error((*entry.path, key), f"is {device}, but function {poll.function} moves registers: D only")
        return
    _check_span(
        (*entry.path, key), device, count, _some(count, "register"), place, report, writes=_writes(key, poll)
    )


def check_coils(entry: Entry[TransactionIn], poll: PollIn, place: Placed, count: int, report: Report) -> None:
    """Coils lie in bits, or packed in D."""
    key, device = _operand(entry, poll, report)
    if device is None:
        return
    if device.letter not in _COIL_LETTERS:
        report.error(
            (*entry.path, key),
            f"is {device}, allowed for coils are {', '.join(_COIL_LETTERS)} (function {poll.function})",
        )
        return
    size = (count + 15) // 16 if device.letter == "D" else count
    path, what = (*entry.path, key), _some(count, "coil")
    _check_span(path, device, size, what, place, report, writes=_writes(key, poll))


def _operand(entry: Entry[TransactionIn], poll: PollIn, report: Report) -> tuple[str, Device | None]:
    """The key and the device of the instruction's operand n."""
    reads = poll.function in READS
    wrong = "from" if reads else "to"
    if getattr(poll, "from_" if reads else "to") is not None:
        verb = "reads" if reads else "writes"
        report.error(
            (*entry.path, wrong), f"has no meaning for function {poll.function}, which {verb}", key=True
        )
    if reads:
        if poll.to is None and not entry.lost("to"):
            report.error((*entry.path, "to"), "is missing")
        return "to", poll.to
    return "from", poll.from_


def _some(count: int, what: str) -> str:
    return f"1 {what}" if count == 1 else f"{count} {what}s"


def _writes(key: str, poll: PollIn) -> bool:
    """Whether something is written into the operand: what was read, or the values to be sent."""
    return key == "to" or bool(poll.values)


def _check_span(
    path: Path, first: Device, size: int, what: str, place: Placed, report: Report, *, writes: bool
) -> None:
    """Where the data end, and what they overwrite if the poll writes there."""
    ranges = WORD_RANGES["D"] if first.letter == "D" else BIT_RANGES[first.letter]
    end = first.address + size - 1
    last = next(last for low, last in ranges if low <= first.address <= last)
    if end > last:
        report.error(path, f"is {first}; its {what} would end beyond {Device(first.letter, last)}")
        return
    if not writes:
        return
    name, until = place.member.name, Device(first.letter, end)
    span = f"{first} to {until}" if size > 1 else f"{first}"
    if first.letter in "DM" and end >= FIRST_SPECIAL:
        report.warn(path, f"{name} writes {what} to {span}: devices from {first.letter}8000 on are special")
    if any(_overlaps(first, end, bit, bits, word, words) for bit, bits, word, words in _blocks(place)):
        report.warn(
            path,
            f"{name} writes {what} to {span}, into the shared block of another station: the link overwrites "
            "them",
        )
    for config in place.member.ports:
        if _overlaps(first, end, config.bits.address, cpavl.BITS, config.words.address, cpavl.WORDS):
            report.warn(path, f"{name} writes {what} to {span}, over the parameters (CPAVL) of {config.name}")


def _blocks(place: Placed) -> list[tuple[int, int, int, int]]:
    blocks = blocks_of(place.member, place.members)
    return [(b.bit, b.bits, b.word, b.words) for at, b in blocks.items() if at != place.member.station]


def _overlaps(first: Device, end: int, bit: int, bits: int, word: int, words: int) -> bool:
    if first.letter == "D":
        return first.address < word + words and word <= end
    return first.letter == "M" and first.address < bit + bits and bit <= end


# -- free protocol -------------------------------------------------------------------------------------


def check_free_data(entry: Entry[TransactionIn], poll: PollIn, place: Placed, report: Report) -> None:
    """Bytes lie in D, one or two a word."""
    if poll.data is not None and poll.text is not None:
        report.error((*entry.path, "text"), "excludes data in the same entry")
    data = poll.data or poll.text or b""
    send_count = poll.send_count if poll.send_count is not None else len(data)
    count = poll.count or 0
    if poll.count is not None and poll.count > 256:
        report.error((*entry.path, "count"), f"is {poll.count}, allowed 0..256 bytes")
        return
    if send_count < len(data):
        report.error(
            (*entry.path, "send_count"), f"is {send_count}, fewer than the {len(data)} bytes that are given"
        )
    if not send_count and not count and not entry.lost("send_count", "count", "data", "text"):
        report.error(entry.path, "neither sends nor receives; expected send_count, data, text or count")
    settings = place.config.valid
    eight_bit = settings is not None and settings.eight_bit
    for key, device, size in (("send", poll.send, send_count), ("to", poll.to, count)):
        if device is None:
            if size and not entry.lost(key):
                holds = "what is received goes into" if key == "to" else "what is sent lies in"
                report.error((*entry.path, key), f"is missing, the first of the D registers that {holds}")
        elif device.letter != "D":
            report.error((*entry.path, key), f"is {device}, but bytes lie in D registers")
        elif size:
            words = size if eight_bit else (size + 1) // 2
            path, what = (*entry.path, key), _some(size, "byte")
            writes = key == "to" or bool(data)
            _check_span(path, device, words, what, place, report, writes=writes)
    timing = settings.timing if settings is not None else None
    if timing is not None and timing.format.data_bits == 7 and any(byte > 127 for byte in data):
        key = "data" if poll.data is not None else "text"
        report.warn(
            (*entry.path, key),
            f"{place.config.node} sends 7 bits a character ({timing.format}): 80H on lose one",
        )
