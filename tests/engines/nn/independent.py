"""A second decoder of the N:N line, written from its description alone; imports nothing of the program.

Line levels are a string of bits, ``1`` idle. Characters are ``(first bit, value, clean)``. What a reader
makes of them is a list of verdicts: ``("frame", text)`` or ``("damage", header, master's digit?)``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

Char = tuple[int, int, bool]
Verdict = tuple[str, str | None] | tuple[str, str | None, bool]

SOH, STX, ETX, ENQ = "\x01", "\x02", "\x03", "\x05"
HEADERS = SOH + STX + ENQ
CHAR_BITS = 10

_FORMS = {
    ENQ: re.compile(r"\x05([1-7][0-9A-F])([0-9A-F]{2})"),
    STX: re.compile(r"\x02([0-7][0-9A-F](?:[0-9A-F]{2}){0,72}\x03)([0-9A-F]{2})"),
    SOH: re.compile(r"\x01(F[0-9A-F][0-9A-F]{8}\x03)([0-9A-F]{2})"),
}


def receive_by_character(text: str) -> str:
    """The bits of a frame on the line."""
    bits = ""
    for sign in text:
        data = f"{ord(sign):07b}"[::-1]
        bits += "0" + data + str(data.count("1") % 2) + "1"
    return bits


def checksum(body: str) -> str:
    total = 0
    for sign in body:
        total += ord(sign)
    return f"{total % 256:02X}"


def poll_text(station: int, counter: int) -> str:
    body = f"{station}{counter:X}"
    return ENQ + body + checksum(body)


def _windows() -> dict[str, tuple[int, bool]]:
    """What the nine bits after a start bit's edge say: value, and whether parity and stop are right."""
    found = {}
    for number in range(1 << 9):
        bits = f"{number:09b}"
        data, parity, stop = bits[:7], bits[7], bits[8]
        value = int(data[::-1], 2)
        found[bits] = value, (data + parity).count("1") % 2 == 0 and stop == "1"
    return found


WINDOWS = _windows()


def characters(bits: str) -> list[Char]:
    """A UART on bits that begin and end idle: from each falling edge the bits' centres are the bits.

    It is ready at the middle of the stop bit, so the next edge may be at that bit's end, not before.
    """
    found = []
    line = "1" + bits + "1" * 2 * CHAR_BITS
    edge = line.find("10") + 1
    while edge:
        value, clean = WINDOWS[line[edge + 1 : edge + CHAR_BITS]]
        found.append((edge - 1, value, clean))
        edge = line.find("10", edge + CHAR_BITS - 1) + 1
    return found


def verdicts(chars: Iterable[Char], data_pairs: int | None = None) -> list[Verdict]:
    """What a receiver makes of characters with quiet after the last one.

    ``data_pairs``: bytes that a data frame must carry, None for any number.
    """
    found: list[Verdict] = []
    for piece in _pieces(chars):
        found += _verdicts_of(piece, data_pairs)
    return found


def _pieces(chars: Iterable[Char]) -> list[str]:
    """Cut at every clean header and at two quiet characters; ``?`` stands for an unclean character."""
    pieces: list[str] = []
    behind = None
    for first, value, clean in chars:
        sign = chr(value) if clean else "?"
        if behind is None or sign in HEADERS or first - behind >= 2 * CHAR_BITS:
            pieces.append("")
        pieces[-1] += sign if sign != "?" or not clean else "!"  # a clean question mark is no hex either
        behind = first + CHAR_BITS
    return pieces


def _verdicts_of(piece: str, data_pairs: int | None) -> list[Verdict]:
    found: list[Verdict] = []
    header = piece[0]
    form = _FORMS.get(header)
    match = form.match(piece) if form else None
    if match and checksum(match[1]) == match[2] and _possible(header, match[1], data_pairs):
        found.append(("frame", match[0]))
        rest = piece[match.end() :]
        return found + ([("damage", None, False)] if rest else [])
    if form is None:
        return [("damage", None, False)]
    return [("damage", header, piece[1:2] == "0")]


def _possible(header: str, body: str, data_pairs: int | None) -> bool:
    if header == STX:
        return data_pairs is None or len(body) == 3 + 2 * data_pairs
    if header == SOH:
        slaves, mode, retries, timeout = (int(body[at : at + 2], 16) for at in (2, 4, 6, 8))
        return 1 <= slaves <= 7 and mode <= 4 and retries <= 10 and 1 <= timeout <= 255
    return True
