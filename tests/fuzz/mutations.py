"""Makes other inputs of given ones: bytes, lines and values of JSON or YAML are changed, left out, doubled."""

from __future__ import annotations

import copy
import json
from collections.abc import Sequence
from random import Random
from typing import Any

#: Values where another was expected.
ODD: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2, 255, 256, 65536, 2**31, -(2**31), 2**63, 10**30, 0.5, -0.0, 1e-300, 1e308,
    "", " ", "x", "0", "-1", "NaN", "1e999", "\x1b[31m", "\u202e", "\ud800", "\U0001f600", "\x00", "a.b", "../x",
    "5ms", "-5ms", "1e30h", "x" * 300, [], {}, [[]], [None], {"": None}, {"x": {"x": []}}, [0] * 40,
)  # fmt: skip
_BYTES = (b"\x00", b"\xff", b"\x1b", b"\r", b"\n", b"\t", b" ", b",", b";", b":", b'"', b"'", b"{", b"[", b"-",
          b"\xef\xbb\xbf", b"\xff\xfe", b"\xc3", "é停µ".encode(), b"9" * 30, b"1e400", b"nan", b"-1", b"0x")  # fmt: skip


def changed(random: Random, data: bytes, seeds: Sequence[bytes], words: Sequence[bytes] = ()) -> bytes:
    """Bytes in one to four places others than they were."""
    for _ in range(random.choice((1, 1, 2, 4))):
        data = _changed_once(random, data, seeds, words)
    return data[:200_000]


def _changed_once(random: Random, data: bytes, seeds: Sequence[bytes], words: Sequence[bytes]) -> bytes:
    at = random.randint(0, len(data))
    end = min(len(data), at + random.choice((1, 1, 2, 4, 8, 64)))
    match random.randrange(9):
        case 0:
            return data[:at] + random.randbytes(end - at) + data[end:]
        case 1:
            return data[:at] + data[end:]
        case 2:
            return data[:at] + data[at:end] * random.choice((2, 3, 20)) + data[end:]
        case 3:
            return data[:at] + random.choice((*words, *_BYTES)) + data[at:]
        case 4:
            return data[:at] + random.choice((*words, *_BYTES)) + data[end:]
        case 5:
            return data[:at]
        case 6:  # another one's end
            other = random.choice(seeds)
            return data[:at] + other[random.randint(0, len(other)) :]
        case 7 if at < len(data):
            return data[:at] + bytes([data[at] ^ 1 << random.randrange(8)]) + data[at + 1 :]
        case _:
            lines = data.split(b"\n")
            one, two = random.randrange(len(lines)), random.randrange(len(lines))
            lines[one : one + random.randint(0, 2)] = [lines[two]]
            return b"\n".join(lines)


def changed_value(random: Random, data: Any) -> Any:
    """A value of JSON with one to three of its parts others than they were."""
    data = copy.deepcopy(data)
    for _ in range(random.choice((1, 1, 2, 3))):
        data = _changed_part(random, data)
    return data


def _changed_part(random: Random, data: Any) -> Any:
    places = [(data, key) for key in _keys(data)]
    for holder, key in places:
        places += [(holder[key], inner) for inner in _keys(holder[key])]
    if not places:
        return random.choice(ODD)
    holder, key = random.choice(places)
    other, other_key = random.choice(places)
    match random.randrange(8):
        case 0:
            del holder[key]
        case 1 if isinstance(holder, list):
            holder.insert(key, copy.deepcopy(holder[key]))
        case 1 | 2 if isinstance(holder, dict):
            name = random.choice(("", "x", "\x1b", str(other_key), f"{key} ", "a.b"))
            holder[name] = copy.deepcopy(holder[key])
        case 3:
            holder[key] = copy.deepcopy(other[other_key])
        case 4 if isinstance(holder[key], int | float):
            holder[key] = holder[key] * random.choice((-1, 2, 1000, 10**15, 0.1))
        case _:
            holder[key] = copy.deepcopy(random.choice(ODD))
    return data


def _keys(value: Any) -> Sequence[Any]:
    return list(value) if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()


def text_of(data: Any) -> bytes:
    """JSON, which YAML is, too."""
    return json.dumps(data).encode()
