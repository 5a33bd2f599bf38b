"""Latencies in words, from ``summary.json``. Times in ms, instants in s."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from bussim.results.numbers import adding_up
from bussim.wording import counted

#: What the parts are called in words; "scan" of a word's age does not exist.
PART_NAMES = {
    "scan": "waiting for the source's scan",
    "turn": "waiting for the station's turn",
    "wire": "on the wire",
    "destination": "waiting for the destination's scan",
    "output": "its output",
}
#: The same of the age of a word.
AGE_PART_NAMES = PART_NAMES | {"destination": "since the frame came, until it was read"}
#: Of the cases of a bound those that stand in words.
_SHOWN_BOUNDS = ("no error", "1 lost reply", "every retry spent")


def shown_bounds(summary: Mapping[str, Any], longest: float = 0.0) -> dict[str, float]:
    """Of the bounds of an entry of the summary those of interest beside its longest latency, all in ms.

    From the least one up to the first that nothing went beyond; empty where there are none.
    """
    bounds: dict[str, float] = summary.get("bound_ms", {})
    ascending = sorted(bounds.values())
    over = next((bound for bound in ascending if bound >= longest), ascending[-1] if ascending else 0.0)
    return {case: bound for case, bound in bounds.items() if bound <= over}


def bounds_in_words(summary: Mapping[str, Any]) -> dict[str, float]:
    """The bounds of an entry of the summary that stand in words (ms), by case."""
    bounds: Mapping[str, float] = summary.get("bound_ms", {})
    return {case: bounds[case] for case in _SHOWN_BOUNDS if case in bounds}


def caveats(summary: Mapping[str, Any]) -> list[str]:
    """What must be said beside an entry's numbers: why there are none, what its bounds depend on."""
    reasons = summary.get("way_reasons") or [f"no bound: {why}" for why in summary.get("bound_reasons", ())]
    notes: Sequence[str] = summary.get("bound_notes", ())
    found = [*reasons, *notes]
    bounds: Mapping[str, float] = summary.get("bound_ms", {})
    longest = summary["ms"]["max"]
    if bounds and longest is not None and longest > max(bounds.values()):
        gated = any("let it through" in note for note in notes)
        shut = "something that did not let it through, " if gated else ""
        found.append(
            f"the longest, {longest:.3f} ms, is beyond all of these cases: {shut}a fault, a link that had "
            "not formed yet, a source in error for longer, or frames that only the target missed"
        )
    return found


def part_names(*, word: bool) -> Mapping[str, str]:
    """What the parts are called, of the age of a word or of a bit's latency."""
    return AGE_PART_NAMES if word else PART_NAMES


def latency_lines(summary: Mapping[str, Any]) -> Iterator[str]:
    """A run's latencies as lines of text, from its summary."""
    for name, entry in summary.get("latency", {}).items():
        yield ""
        yield f"{heading(name, entry, ': ')}, {edge_in_words(entry)}"
        yield f"  {counts_in_words(entry)}"
        times = entry["ms"]
        hint = lost_in_words(entry)
        if hint:
            yield f"  {hint}"
        bounds = bounds_in_words(entry) if times["max"] is not None else {}
        if times["max"] is not None:
            numbers = {"min": "min", "median": "p50", "mean": "mean", "p99": "p99", "max": "max"}
            shown = [f"{word} {times[key]:.3f}" for word, key in numbers.items() if times[key] is not None]
            yield f"  {'age' if entry['edge'] is None else 'latency':<16} {', '.join(shown)} ms"
            names = part_names(word=entry["edge"] is None)
            shares = entry["parts_ms"]
            told = {part: word for part, word in names.items() if None not in shares[part].values()}
            parts = {word: shares[part]["mean"] for part, word in told.items() if shares[part]["max"]}
            if parts and times["mean"] is not None:
                texts = adding_up(list(parts.values()), times["mean"])
                said = (f"{part} {text}" for part, text in zip(parts, texts, strict=True))
                yield f"  on average       {', '.join(said)} ms"
        if cases := [f"{bound:.3f} with {case}" for case, bound in bounds.items()]:
            yield f"  at worst         {', '.join(cases)} (ms)"
        yield from (f"  {' ' * 17 if cases else ''}{said}" for said in caveats(entry))


def heading(name: str, entry: Mapping[str, Any], between: str = ", ") -> str:
    """The name of an entry of the summary, where it has one, and its two devices with their comments."""
    ends = (entry["from"], entry["to"])
    comments: Mapping[str, str] = entry.get("comments", {})
    said = " to ".join(f"{end} ({comments[end]})" if end in comments else end for end in ends)
    return said if name == " to ".join(ends) else f"{name}{between}{said}"


def edge_in_words(entry: Mapping[str, Any]) -> str:
    """What is measured of an entry of the summary."""
    if entry["edge"] is None:
        return "age of the word whenever it is read"
    edge = "either edge" if entry["edge"] == "both" else f"{entry['edge']} edge"
    return f"{edge}, inverted" if entry["inverted"] else edge


def counts_in_words(entry: Mapping[str, Any]) -> str:
    """What became of the changes of an entry of the summary."""
    changes = counted(entry["changes"], "change")
    if entry["edge"] is None:
        return f"{changes} of the source; read {counted(entry['delivered'], 'time')}"
    found = [f"{changes}: {entry['delivered']:,} arrived"]
    words = {"lost": "never arrived", "unseen": "too short to be seen", "open": "under way at the end"}
    found += [f"{entry[key]:,} {word}" for key, word in words.items() if entry[key]]
    return ", ".join(found)


def lost_in_words(entry: Mapping[str, Any]) -> str:
    """How many of the changes that never arrived need no lost frame for it; empty where none did."""
    short, gap = entry.get("lost_short"), entry.get("longest_gap_ms")
    if not short or gap is None or entry.get("way_reasons"):
        return ""
    return (
        f"of those that never arrived, {short:,} began or ended a pulse no longer than the longest gap "
        f"between the station's frames, {gap:.3f} ms: it may lie between two of them"
    )
