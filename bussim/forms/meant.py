"""What a value is in the file, and what a wrong one may have been meant as."""

import re
from collections.abc import Iterator
from typing import Any

from bussim.wording import RawFloat, RawInt, plain_form

_QUANTITY = re.compile(r"[K#]?([+-]?\d{1,12}(?:[.,]\d{0,12})?(?:e[+-]?\d\d?)?) *(k|%|[a-z]*)", re.IGNORECASE)
_HEXADECIMAL = re.compile(r"(?:H|\$)([0-9A-F]{1,8})|([0-9A-F]{1,8})H", re.IGNORECASE)
_YES, _NO = "yes on y 1 true ja ein 是 开", "no off n 0 false nein aus 否 关"


def unread(value: object) -> object:
    """A value as the file has it: YAML may have read a text as a number."""
    return value.raw if isinstance(value, RawInt | RawFloat) else value


def readings(value: object) -> Iterator[Any]:
    """What a value that is wrong may have been meant as, what is nearer to it first."""
    text = "".join(plain_form(char) or char for char in str(unread(value))).strip(" \"'")
    if found := _HEXADECIMAL.fullmatch(text):
        digits = found[1] or found[2]
        yield RawInt(int(digits, 16), f"0x{digits.upper()}")
    elif found := _QUANTITY.fullmatch(text):
        number = float(found[1].replace(",", ".")) * {"k": 1000, "%": 0.01}.get(found[2], 1)
        yield from (round(number), number) if number == round(number) else (number,)
        if re.fullmatch(r"\d+[.,]\d{3}", found[1]):
            yield int(re.sub(r"\D", "", found[1]))
    yield from (flag for words, flag in ((_YES, True), (_NO, False)) if text.lower() in words.split())
    if isinstance(value, str | int) and value not in ("", True, False):
        yield from (text, text.upper(), re.sub(r"[^\w.-]+", "_", text).strip("_-"))
