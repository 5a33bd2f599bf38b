"""The signal path of each entry of ``latency``: over which link, and through the programs where it is plain.

A path is *plain* where it can be followed back from the target: each device on it has one instruction that
writes it, a coil (OUT) whose rung has one contact that depends on the source, or a MOV whose condition does
not. Then the source's level decides the target's, after a known number of scans. Anything else (timers,
counters, pulses, latches, comparisons, arithmetic, second writers, jumps, index registers) is the reason
why nothing is said of it: the first that is met.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import assert_never

from bussim.engines.nn.frames import data_chars
from bussim.line.characters import NN_LINE
from bussim.plc.memory import FIRST_SPECIAL, Device, parse_device
from bussim.plc.program.text.catalog import Instruction
from bussim.plc.program.text.ladder import Both, Condition, Contact, Either, Not, Saved, parts
from bussim.plc.program.text.operand_checks import READ_ONLY_BITS, extents
from bussim.scenario.model import Latency, Plc, Scenario
from bussim.scenario.signals.network import Marks, Network, Reachability, vague_instructions
from bussim.words.language import say

#: Always on and always off (FX programming manual).
_ALWAYS = (Device("M", 8000), Device("M", 8001))
#: Special bits that no program changes: of the clock and RUN, the error flags of the link's stations.
_KNOWN_SPECIALS = READ_ONLY_BITS | set(range(8183, 8192))


class NotPlainError(Exception):
    """A signal path is not plain; the message says why."""


@dataclass(frozen=True, slots=True)
class SignalPath:
    """The path of one entry. ``bus`` is None where source and target are of one PLC.

    ``positions`` are those of source and target among the PLCs on the link, ``frame`` the ticks of a data
    frame (0 without a working master). ``direct``: nothing but the link comes between the block that is
    sent and the target. ``reason`` says why the path is not plain. Where it is, ``scans`` are those that
    the programs of source and target take beyond the one that reads the signal, one for each rung that
    stands in front of the one whose result it reads, and ``gates`` the contacts that must let the signal
    through, as "X1 (feeder)", for a source that goes off (0) and one that goes on (1).
    """

    entry: Latency
    source: Plc
    target: Plc
    bus: str | None
    positions: tuple[int, int]
    frame: int
    direct: bool
    reachability: Reachability
    reason: str
    scans: tuple[int, int]
    gates: Mapping[int, Sequence[str]]

    @property
    def word(self) -> bool:
        """Whether the age of a word is measured, not the latency of a bit's changes."""
        return parse_device(self.entry.source, observed=True).is_word

    @property
    def unmeasured(self) -> str:
        """Why nothing leads from source to target, or no age can be measured of a word; else empty."""
        return self.reason if self.word or self.reachability is Reachability.NONE else ""


def signal_paths(scenario: Scenario) -> tuple[SignalPath, ...]:
    """The paths of all entries of ``latency``, in their order."""
    networks: dict[str | None, Network] = {}
    found = []
    for entry in scenario.latency:
        source = next(plc for plc in scenario.plcs if plc.name == entry.source_plc)
        bus = source.link.bus if source.link is not None else None
        key = bus if bus is not None else f"{source.name} alone"
        if key not in networks:
            linked = tuple(plc for plc in scenario.plcs if plc.link is not None and plc.link.bus == bus)
            networks[key] = Network(linked if bus is not None else (source,))
        found.append(_signal_path(networks[key], entry, bus))
    return tuple(found)


def _signal_path(network: Network, entry: Latency, bus: str | None) -> SignalPath:
    names = [plc.name for plc in network.plcs]
    positions = names.index(entry.source_plc), names.index(entry.target_plc)
    source, target = (network.plcs[position] for position in positions)
    start, end = (parse_device(name, observed=True) for name in (entry.source, entry.target))
    reachability = network.reachability(source, start, target, end)
    ends = {"start": f"{entry.source_plc}.{entry.source}", "end": f"{entry.target_plc}.{entry.target}"}
    reason, scans, gates = "", (0, 0), dict[int, list[str]]()
    match reachability:
        case Reachability.NONE:
            reason = say("path_none", **ends)
            if source is not target:
                reason = say("path_none_shared", **ends, shared=network.shared(source))
        case Reachability.UNKNOWN:
            reason = say("path_unknown", **ends)
        case Reachability.DIRECT:
            try:
                search = _PathSearch(network, source, start, target)
                for wanted in (0, 1):
                    level, scans, gates[level] = search.back(end, wanted)
            except NotPlainError as error:
                why = error.args[0]
                reason = say("path_no_age", **ends, why=why) if start.is_word else why
        case _:
            assert_never(reachability)
    block = network.block(source, target)
    return SignalPath(
        entry,
        source,
        target,
        bus if source is not target else None,
        positions,
        0 if network.mode is None else NN_LINE.characters(data_chars(network.mode)),
        source is target or (block is not None and block.holds(end)),
        reachability,
        reason,
        scans,
        gates,
    )


class _PathSearch:
    """Follows a signal back from its target to its source. Raises NotPlainError where it cannot."""

    def __init__(self, network: Network, source: Plc, start: Device, target: Plc) -> None:
        self._network = network
        self._source, self._start, self._target = source, start, target
        #: What may depend on the source, also over other stations.
        self._reached: dict[str, Marks] = network.reached(source, start)
        for plc in (source, target):
            for at in vague_instructions(plc):
                raise _refused(plc, at)

    def back(self, end: Device, level: int) -> tuple[int, tuple[int, int], list[str]]:
        """The source's level for which a device of the target takes ``level``; the path's scans and gates."""
        plc, device = self._target, end
        reader: int | None = None  # number of the instruction that reads the device; None: an END shows it
        scans, gates, passed = [0, 0], list[str](), set[tuple[str, Device]]()
        while (plc, device) != (self._source, self._start):
            if (plc.name, device) in passed:
                raise NotPlainError(say("path_itself", device=str(device), plc=plc.name))
            passed.add((plc.name, device))
            sent = self._sent(device) if plc is not self._source else None
            if sent is not None:
                self._only(plc, device, 0)
                plc, device, reader = self._source, sent, None
                continue
            at, condition = self._writer(plc, device)
            scans[plc is not self._source] += reader is not None and reader <= at.number
            if at.spec.name == "OUT" and at.operands[0].kind in "YMS":
                contact, level, more = self._decisive(plc, at, condition, level)
                device, reader = contact.operands[0].device, contact.number
            else:
                device, reader, more = self._moved(plc, at, condition, device), at.number, [condition]
            gates = [*self._gates(plc, more), *gates]
        scans[0] += self._first_scan(reader)
        if end.is_word and (gates or any(scans)):
            why = say("path_gates", gates=", ".join(gates)) if gates else say("path_scans")
            raise NotPlainError(say("path_no_copy", device=str(end), why=why))
        return level, (scans[0], scans[1]), list(dict.fromkeys(gates))

    def _sent(self, device: Device) -> Device | None:
        """The device of the source that the link copies to a device of the target."""
        own, copy = (self._network.block(self._source, plc) for plc in (self._source, self._target))
        if own is None or copy is None or not copy.holds(device):
            return None
        return device._replace(address=device.address + (own.word - copy.word) * device.is_word)

    def _writers(self, plc: Plc, device: Device) -> list[tuple[Instruction, Condition]]:
        """The instructions that write a device, with their conditions."""
        letter = device.letter.removesuffix("N")
        return [
            (node.at, node.condition)
            for node in self._network.nodes[plc.name]
            if node.at is not None
            and any(extent.holds(letter, device.address, word=device.is_word) for extent in node.writes)
        ]

    def _writer(self, plc: Plc, device: Device) -> tuple[Instruction, Condition]:
        """The only instruction that writes a device, with its condition."""
        found = self._writers(plc, device)
        if not found:
            key = "path_other_writes" if self._linked(plc, device) else "path_nothing_writes"
            raise NotPlainError(say(key, device=str(device), plc=plc.name))
        self._only(plc, device, 1, link=self._linked(plc, device))
        return found[0]

    def _only(self, plc: Plc, device: Device, most: int, *, link: bool = False) -> None:
        """Refuse a device that more than so many instructions write, or a source, or as well the link."""
        others = [_words(at) for at, _ in self._writers(plc, device)[most:]]
        others += [say("path_source")] if str(device) in plc.sources else []
        others += [say("path_link")] if link else []
        if others:
            raise NotPlainError(say("path_writes_too", by=others[0], device=str(device), plc=plc.name))

    def _linked(self, plc: Plc, device: Device) -> bool:
        """Whether the link writes a device: it is in the block of another station."""
        blocks = (self._network.block(other, plc) for other in self._network.plcs if other is not plc)
        return any(block is not None and block.holds(device) for block in blocks)

    def _moved(self, plc: Plc, at: Instruction, condition: Condition, device: Device) -> Device:
        """The device that a MOV copies to a device, in each scan in which its condition is on."""
        found = extents(at)
        if at.name not in ("MOV", "DMOV") or len(found) != 2 or self._depends(plc, condition):
            raise _refused(plc, at)
        read, written = found
        address = read.first + device.address - written.first
        if read.word is not written.word or address > read.last:
            raise _refused(plc, at)
        return Device(read.letter + "N" * (read.word and read.letter in "TC"), address)

    def _decisive(
        self, plc: Plc, at: Instruction, condition: Condition, level: int
    ) -> tuple[Instruction, int, list[Condition]]:
        """The contact of a coil's condition that depends on the source.

        Also the level of its device for which the coil takes ``level``, and what must let it through.
        """
        gates: list[Condition] = []
        while not isinstance(condition, Contact):
            match condition:
                case Saved(rung):
                    condition = rung.condition
                case Not(part):
                    condition, level = part, 1 - level
                case Both() | Either():
                    sides = [condition.first, condition.second]
                    follows = [self._depends(plc, side) for side in sides]
                    if all(follows):
                        names = {"at": _words(at), "device": str(self._start), "plc": plc.name}
                        raise NotPlainError(say("path_several", **names))
                    if level == isinstance(condition, Both):
                        gates.append(sides[follows[0]])
                    condition = sides[follows[1]]
                case _:
                    assert_never(condition)
        contact = condition.instruction
        if not _is_plain(contact):
            raise _refused(plc, contact)
        return contact, level ^ (contact.spec.test == "off"), gates

    def _depends(self, plc: Plc, condition: Condition) -> bool:
        """Whether any contact of a condition may depend on the source."""
        return any(map(self._reached[plc.name].hold, self._network.reads(condition)))

    def _gates(self, plc: Plc, conditions: list[Condition]) -> Iterator[str]:
        """The contacts of some conditions but those that are always on or off, as "X1 (feeder)"."""
        waiting = conditions[::-1]
        while waiting:
            contacts, rungs = parts(waiting.pop())
            waiting += [rung.condition for rung in rungs]
            for at in contacts:
                device = at.operands[0].device
                special = device.address >= FIRST_SPECIAL and device.address not in _KNOWN_SPECIALS
                if not _is_plain(at) or special:
                    raise _refused(plc, at)
                if device not in _ALWAYS:
                    yield f"{device} ({plc.name})"

    def _first_scan(self, reader: int | None) -> int:
        """Scans that the source's program takes to read it: an END shows what is read in the next scan."""
        if reader is None or self._start.letter == "X":
            return 0
        later = {int(reader <= at.number) for at, _ in self._writers(self._source, self._start)}
        beside = str(self._start) in self._source.sources or self._linked(self._source, self._start)
        if not self._start.is_word and (beside or not later):
            later.add(1)
        if len(later) > 1:
            names = {"device": str(self._start), "plc": self._source.name}
            raise NotPlainError(say("path_between", **names))
        return sum(later)


def _words(at: Instruction) -> str:
    code = " ".join((at.name, *(operand.text for operand in at.operands)))
    return say("path_at_line", code=code, line=at.line)


def _is_plain(at: Instruction) -> bool:
    """Whether a contact is that of one bit, on or off."""
    first = at.operands[0]
    return at.spec.test in ("on", "off") and first.index is None and first.kind != "D.b"


def _refused(plc: Plc, at: Instruction) -> NotPlainError:
    return NotPlainError(say("path_not_plain", at=_words(at), plc=plc.name))
