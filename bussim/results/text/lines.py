"""Lines of text with a label before them, and statistics of times in words."""

import re
from collections.abc import Mapping, Sequence

from bussim.words.language import say, shown
from bussim.words.tables import recognised

#: Columns of a label.
_LABEL = 16
_NAMES = {"min": "time_min", "p50": "time_median", "mean": "time_mean", "p99": "time_p99", "max": "time_max"}


_LASTING = re.compile(r"(.+) for (\d\S* \w+)", re.DOTALL)


def fault_in_words(text: str) -> str:
    """A fault as a trace names it, also in another language."""
    if lasting := _LASTING.fullmatch(text):
        fault, time = lasting.groups()
        return say("fault_for", fault=recognised(fault, "fault_"), time=time)
    return recognised(text, "fault_")


def labelled(label: str, text: str) -> str:
    """A line in the language that is used: a label in its column, and a text."""
    from rich.cells import cell_len

    word = shown(label)
    return f"  {word}{' ' * (_LABEL - cell_len(word))} {shown(text)}"


def number_named(key: str) -> str:
    """What a statistic of the summary is called."""
    return say(_NAMES[key])


def times_in_words(times: Mapping[str, float | None], keys: Sequence[str] = ("p50", "p99", "max")) -> str:
    """Statistics of times in ms, ``median 50.406, p99 50.414, max 51.103 ms``; unknown ones left out."""
    known = [key for key in keys if times[key] is not None]
    return say("times_ms", times=[say("time_value", name=number_named(key), ms=times[key]) for key in known])
