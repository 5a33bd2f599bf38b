"""Why frames do not tell the age of a word: it never travels, or a program decides.

What is measured is the time since the END that left the source's block, whenever the target's PLC begins a
scan. That is the age of a word of this block, and of its copies: those that every scan of a program makes,
unconditionally, with nothing else that writes them, and of what it has in this very scan.
"""

from __future__ import annotations

from collections.abc import Iterable

from bussim.plc.memory import BlockPlace
from bussim.plc.program.program import Program
from bussim.scenario.signals.program_signals import Key, Point, Signals
from bussim.scenario.signals.reachability import Finding, Lead, Question, signals_of

_WANDERS = frozenset(("CALL", "FOR", "CJ", "FEND"))


def age_reasons(question: Question, finding: Finding) -> tuple[str, ...]:
    """Why no age can be measured; empty where it can. ``finding`` is how the source leads to the target."""
    net, start, end = question.net, question.start, question.end
    source, target = (net.stations[place] for place in question.ends)
    if finding.lead is Lead.NONE:
        return (f"{start} of {source.name} never travels to {end} of {target.name}: {finding.why}",)
    if finding.lead is Lead.ROUND:
        return (f"{start} of {source.name} reaches {end} of {target.name} over other stations only",)
    own, there = net.block(question.source, question.source), net.block(question.source, question.target)
    if finding.lead is Lead.UNKNOWN or own is None or there is None:
        return (f"the texts of the programs do not tell how {start} of {source.name} reaches {end}",)
    block = {Key("D", address, word=True) for address in range(own.word, own.word + own.words)}
    sent, why = {start} & block, ""
    if not sent:
        sent, why = _copies(source.program, {start}, block, there=False)
        if not sent:
            return (f"{start} is in no shared block, and {why} ({source.name})",)
    kept = {_moved(key, own, there) for key in sent}
    if end in kept:
        return ()
    if question.foreign:
        return (f"the link itself writes {end} in {target.name}: it is in the block of a station",)
    found, why = _copies(target.program, kept, {end}, there=True)
    return () if found else (f"{end} is no copy that is made in every scan: {why} ({target.name})",)


def _moved(key: Key, own: BlockPlace, there: BlockPlace) -> Key:
    return key._replace(address=key.address + there.word - own.word)


def _copies(
    program: Program | None, starts: Iterable[Key], ends: set[Key], *, there: bool
) -> tuple[set[Key], str]:
    """Of the ends those that are the starts' copies in every scan, or what is in the way.

    ``there``: the starts are written by the link alone, before the scan.
    """
    signals = signals_of(program)
    if program is not None and any(at.spec.name in _WANDERS for at in program.instructions):
        return set(), "its program has jumps, loops or subroutines"
    found, why, last = set[Key](), "nothing copies it there directly", False
    seen: set[Point] = set()
    waiting = [point for key in starts for point in _origins(signals, key, there=there)]
    while waiting:
        point = waiting.pop()
        for step in signals.steps(point):
            to = step.to
            if to in seen or to.key is None or not to.key.word:
                continue
            seen.add(to)
            if last and to.key not in ends:
                continue  # what is in the way at the end is told
            line = next((at.line for at in signals.written(to.key) if at.number == to.number), 0)
            if step.reason:
                why = step.reason
            elif step.gates:
                why = f"{', '.join(step.gates)} must let it through at line {line}"
            elif step.later:
                why = f"line {line} stands in front of what it reads, and copies what was there a scan ago"
            elif len(signals.written(to.key)) > 1 or signals.indexed:
                why = f"more than line {line} may write {to.key}"
            elif to.key in ends:
                found.add(to.key)
            else:
                waiting.append(to)
                continue
            last = to.key in ends
    return found, why


def _origins(signals: Signals, key: Key, *, there: bool) -> list[Point]:
    """The last that writes a device before it is copied: if the program does, its last instruction."""
    written = [] if there else [at.number for at in signals.written(key)]
    return [Point(key, max(written, default=-1), 0)]
