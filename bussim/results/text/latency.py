"""Latencies in words, from ``summary.json``. Times in ms, instants in s."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from bussim.results.numbers import adding_up
from bussim.results.text.lines import labelled, times_in_words
from bussim.words.language import say, shown
from bussim.words.tables import recognised

#: The parts of a latency; "scan" of a word's age does not exist.
_PARTS = ("scan", "turn", "wire", "destination", "output")
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


def case_in_words(case: str) -> str:
    """A case of a bound, as the summary has it, in words."""
    number = case.partition(" ")[0]
    if number.isdigit():
        return say("bound_lost_one" if number == "1" else "bound_lost", number=int(number))
    return say("bound_no_error" if case == "no error" else "bound_every")


def caveats(summary: Mapping[str, Any]) -> list[str]:
    """What must be said beside an entry's numbers: why there are none, what its bounds depend on."""
    reasons = [recognised(why) for why in summary.get("way_reasons") or ()]
    if not reasons:
        reasons = [say("bound_none", reason=recognised(why)) for why in summary.get("bound_reasons", ())]
    notes: Sequence[str] = summary.get("bound_notes", ())
    found = [*reasons, *map(recognised, notes)]
    bounds: Mapping[str, float] = summary.get("bound_ms", {})
    longest = summary["ms"]["max"]
    if bounds and longest is not None and longest > max(bounds.values()):
        gated = any("let it through" in note for note in notes)
        found.append(say("latency_beyond_gated" if gated else "latency_beyond", longest=longest))
    return found


def part_names(*, word: bool) -> Mapping[str, str]:
    """What the parts are called, of the age of a word or of a bit's latency."""
    key = {"destination": "age_destination"} if word else {}
    return {part: say(f"latency_part_{key.get(part, part)}") for part in _PARTS}


def latency_lines(summary: Mapping[str, Any]) -> Iterator[str]:
    """A run's latencies as lines of text in the language that is used, from its summary."""
    for name, entry in summary.get("latency", {}).items():
        yield ""
        about = heading(name, entry, "latency_named")
        yield shown(say("latency_line", heading=about, edge=edge_in_words(entry)))
        yield f"  {shown(counts_in_words(entry))}"
        times = entry["ms"]
        hint = lost_in_words(entry)
        if hint:
            yield f"  {shown(hint)}"
        bounds = bounds_in_words(entry) if times["max"] is not None else {}
        if times["max"] is not None:
            label = say("latency_age" if entry["edge"] is None else "latency_latency")
            yield labelled(label, times_in_words(times, ("min", "p50", "mean", "p99", "max")))
            names = part_names(word=entry["edge"] is None)
            shares = entry["parts_ms"]
            told = {part: word for part, word in names.items() if None not in shares[part].values()}
            parts = {word: shares[part]["mean"] for part, word in told.items() if shares[part]["max"]}
            if parts and times["mean"] is not None:
                texts = adding_up(list(parts.values()), times["mean"])
                said = [
                    say("latency_share", part=part, text=text)
                    for part, text in zip(parts, texts, strict=True)
                ]
                yield labelled(say("latency_average"), say("latency_shares", parts=said))
        cases = [say("latency_with", bound=bound, case=case_in_words(case)) for case, bound in bounds.items()]
        if cases:
            yield labelled(say("latency_worst"), say("latency_cases", cases=cases))
        yield from (f"  {' ' * 17 if cases else ''}{shown(said)}" for said in caveats(entry))


def heading(name: str, entry: Mapping[str, Any], key: str = "latency_named_comma") -> str:
    """The name of an entry of the summary, where it has one, and its two devices with their comments."""
    ends = (entry["from"], entry["to"])
    comments: Mapping[str, str] = entry.get("comments", {})
    start, end = (
        say("latency_end", end=each, comment=comments[each]) if each in comments else each for each in ends
    )
    said = say("latency_ends", start=start, end=end)
    return said if name == " to ".join(ends) else say(key, name=name, ends=said)


def edge_in_words(entry: Mapping[str, Any]) -> str:
    """What is measured of an entry of the summary."""
    if entry["edge"] is None:
        return say("latency_edge_word")
    edge = say(f"latency_edge_{entry['edge']}")
    return say("latency_inverted", edge=edge) if entry["inverted"] else edge


def counts_in_words(entry: Mapping[str, Any]) -> str:
    """What became of the changes of an entry of the summary."""
    changes = entry["changes"]
    if entry["edge"] is None:
        return say("latency_counts_word", changes=changes, reads=entry["delivered"])
    found = [say("latency_arrived", number=entry["delivered"])]
    found += [say(f"latency_{key}", number=entry[key]) for key in ("lost", "unseen", "open") if entry[key]]
    return say("latency_counts", changes=changes, found=found)


def lost_in_words(entry: Mapping[str, Any]) -> str:
    """How many of the changes that never arrived need no lost frame for it; empty where none did."""
    short, gap = entry.get("lost_short"), entry.get("longest_gap_ms")
    if not short or gap is None or entry.get("way_reasons"):
        return ""
    return say("latency_lost_short", short=short, gap=gap)
