"""How messages show a scenario's values; the names of the layers below are passed on."""

from __future__ import annotations

from bussim.wording import names, nearest, shorten, suggest

__all__ = ["RawFloat", "RawInt", "names", "nearest", "shorten", "show", "suggest"]


class RawInt(int):
    """A whole number with the text that it had in the file (``0x16``)."""

    raw: str

    def __new__(cls, value: int, raw: str) -> RawInt:
        """The number ``value``, written as ``raw``."""
        self = super().__new__(cls, value)
        self.raw = raw
        return self


class RawFloat(float):
    """A number with the text that it had in the file: ``7E1`` may be meant as a character format."""

    raw: str

    def __new__(cls, value: float, raw: str) -> RawFloat:
        """The number ``value``, written as ``raw``."""
        self = super().__new__(cls, value)
        self.raw = raw
        return self


def show(value: object) -> str:
    """A value as the user wrote it, short: text in quotes, true and false as YAML has them."""
    if isinstance(value, RawInt | RawFloat):
        return shorten(value.raw)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return shorten(repr(value))
    if isinstance(value, int | float):
        return shorten(_number(value))
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list | tuple):
        return "a list"
    return f"of the type {type(value).__name__}"


def _number(value: int | float) -> str:
    # Python refuses to print a whole number of thousands of digits.
    if isinstance(value, int) and value.bit_length() > 256:
        return f"a number of {value.bit_length()} bits"
    return str(value)
