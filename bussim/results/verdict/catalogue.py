"""The sentences of verdicts, which say what was well or that something was wrong."""

from collections.abc import Mapping
from typing import Any

from bussim.words.formats import render
from bussim.words.tables import LANGUAGES, Said, entries

#: Sentences of folders of earlier versions, which have their texts.
_FORMER_FAULTS = frozenset({"cause_late", "cause_stopped", "cause_still_stopped", "cause_unreached"})


def is_fault(key: str) -> bool:
    """Whether a sentence says that something was wrong; one of a later version does not."""
    return "fault" in entries().get(key, ())[len(LANGUAGES) :] or key in _FORMER_FAULTS


def sentence(item: Mapping[str, Any]) -> str:
    """A sentence of a summary's verdict; one that another version said otherwise is its text alone."""
    key, values, text = item["key"], item["values"], item["text"]
    try:
        return Said(text, key, values) if render(key, values) == text else text
    except (KeyError, ValueError, TypeError):
        return str(text)
