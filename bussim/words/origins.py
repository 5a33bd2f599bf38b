"""Where figures come from, in words: classes of what they are made of, and so of the figures."""

import re
from collections.abc import Mapping

from bussim.words.language import say
from bussim.words.tables import Said, entries, keys_of, recognised

#: The classes, the weakest last. Where something was measured, its recording follows: "measured in line.sr".
CLASSES = "published", "measured", "derived", "entered", "assumed"
MEASURED = CLASSES[1]
_ASSUMPTION = re.compile("(.+?); (.+?): (.+)")


def rank(origin: str) -> int:
    """The place of an origin's class among :data:`CLASSES`."""
    return CLASSES.index(origin.split()[0])


def origin_in_words(origin: str) -> str:
    """A class with the recordings."""
    weakest, _, part = origin.partition(f" (in part {MEASURED} in ")
    if part:
        return say("from_in_part", origin=origin_in_words(weakest), files=part.removesuffix(")"))
    name, _, recordings = origin.partition(" in ")
    if recordings:
        return say("from_measured_in", files=recordings)
    return say(f"from_{name}") if f"from_{name}" in entries() else name


def in_words(found: Mapping[str, Mapping[str, str]]) -> list[str]:
    """The inputs by where they come from, the strongest first, and then the figures by their classes."""
    inputs, figures, keys = found["inputs"], found["figures"], keys_of("input_")
    lines = []
    for origin in sorted(set(inputs.values()), key=rank):
        names = [say(keys[name]) if name in keys else name for name, at in inputs.items() if at == origin]
        lines.append(say("from_inputs", origin=origin_in_words(origin), names=names))
    *strong, weakest = sorted(set(figures.values()), key=rank)
    parts = []
    for origin in strong:
        names = [_figure(key) for key, at in figures.items() if at == origin]
        parts.append(say("from_figures", origin=origin_in_words(origin), names=names))
    parts.append(say("from_others" if strong else "from_all", origin=origin_in_words(weakest)))
    return [*lines, say("from_weakest", parts=parts)]


def assumption_in_words(text: str) -> str:
    """An assumption that changes figures, as a summary has it in English."""
    parts = _ASSUMPTION.fullmatch(text)
    if isinstance(text, Said) or parts is None:
        return text
    name, alternative, changes = parts.groups()
    texts = say("comma_list", texts=[_part(each) for each in changes.split(", ")])
    return say("assume_changes", name=_part(name), alternative=_part(alternative), changes=texts)


def _part(text: str) -> str:
    said, readings = recognised(text, "assume_"), keys_of("reading_")
    if not isinstance(said, Said):
        return text
    values = said.values.items()
    return say(said.key, **{name: say(readings[each]) if each in readings else each for name, each in values})


def _figure(key: str) -> str:
    """What a figure is called by its key in the JSON forms."""
    name = key.removesuffix("_ms")
    return say(f"figure_{name}") if f"figure_{name}" in entries() else name.replace("_", " ")
