"""Parts of messages: a value as the user has it, what is odd about it, and what may be meant instead."""

import re
import unicodedata
from collections.abc import Sequence

from bussim.wording import RawFloat, RawInt, names, nearest, plain_form, shorten
from bussim.words.language import say
from bussim.words.tables import recognised


def show(value: object) -> str:
    """A value as the user wrote it, short: text in quotes, true and false as YAML has them."""
    if isinstance(value, RawInt | RawFloat):
        return shorten(value.raw)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return shorten(repr(value))
    if isinstance(value, int | float):
        return _number(value)
    if isinstance(value, dict):
        return say("form_mapping")
    if isinstance(value, list | tuple):
        return say("form_a_list")
    return say("form_type", type=type(value).__name__)


def _number(value: int | float) -> str:
    # Python refuses to print a whole number of thousands of digits.
    if isinstance(value, int) and value.bit_length() > 256:
        return say("form_number_bits", bits=value.bit_length())
    return shorten(str(value))


def describe(char: str) -> str:
    """A character with its name in Unicode; one that is not seen by its number."""
    if char == "\t":
        return say("form_a_tab")
    shown = f"U+{ord(char):04X}" if char.isspace() else char
    name = recognised(unicodedata.name(char, "no name").lower(), "char_")
    return say("form_character_is", shown=shown, name=name)


def odd(value: object) -> str:
    """A hint at the end of a message about a text that has something beside a value, "" if it has not."""
    if not isinstance(value, str):
        return ""
    for char in value:
        plain = plain_form(char)
        if plain is not None:
            return say("form_odd", found=describe(char), write=plain if plain.strip() else say("mend_blank"))
    if re.search(r"[^\s]#|//", value):
        return say("form_odd_comment")
    return say("form_odd_end", end=value[-1]) if value.endswith((",", ";")) else ""


def suggest(name: str, options: Sequence[str]) -> str:
    """The end of a message about an unknown name: the nearest right one, or all that there are."""
    near = nearest(name, options)
    if near is not None:
        return say("form_mean", near=near)
    return say("form_allowed_are", names=names(options)) if options else say("form_there_are_none")
