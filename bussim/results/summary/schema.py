"""What readers rely on in ``summary.json``, by key: what every version with this schema writes.

A key that ends in ``?`` may be missing, as only some runs or later versions have it. Keys that are not named
here, those of a version to come, may hold anything.
"""

from collections.abc import Callable, Mapping
from functools import partial
from types import NoneType
from typing import Any

from bussim.results.meters.latency_record import PARTS
from bussim.words.origins import CLASSES
from bussim.words.values import show

#: Raises ValueError with the key (the second argument) where a value is another one than it must be.
Check = Callable[[Any, str], None]

#: Statistics have all of these, or none.
_TOGETHER = ("min", "mean", "max", "max_at_s")
#: Numbers are less, by far, so that no arithmetic with them overflows.
_LARGEST = 1 << 62


def _of(what: str, *types: type) -> Check:
    def check(value: Any, where: str) -> None:
        number = isinstance(value, int | float)
        if type(value) not in types or (number and not -_LARGEST < value < _LARGEST):
            raise ValueError(f"{where} is {'null' if value is None else show(value)}, not {what}")

    return check


_COUNT, _COUNT_OR_NONE = _of("a whole number", int), _of("a whole number or null", int, NoneType)
_KNOWN, _NUMBER = _of("a number", int, float), _of("a number or null", int, float, NoneType)
_TEXT, _TEXT_OR_NONE = _of("a text", str), _of("a text or null", str, NoneType)
_FLAG, _LIST, _OBJECT = _of("true or false", bool), _of("a list", list), _of("an object", dict)


def _one_of(*words: str | None) -> Check:
    def check(value: Any, where: str) -> None:
        if value not in words:
            allowed = ", ".join(word or "null" for word in words)
            raise ValueError(f"{where} is {show(value)}, allowed are {allowed}")

    return check


def _origin(value: Any, where: str) -> None:
    _TEXT(value, where)
    _one_of(*CLASSES)(value.partition(" ")[0], where)


def _each(kind: Check, one: Check) -> Check:
    def check(value: Any, where: str) -> None:
        kind(value, where)
        for name, entry in value.items() if isinstance(value, dict) else enumerate(value):
            one(entry, f"{where}.{name}")

    return check


_list, _by_name = partial(_each, _LIST), partial(_each, _OBJECT)


def _keys(checks: Mapping[str, Check], **more: Mapping[str, Check]) -> Check:
    """The check of an object by its keys; ``more`` are further ones of those that have a certain key."""

    def check(value: Any, where: str) -> None:
        _OBJECT(value, where)
        wanted = [
            *checks.items(),
            *(pair for key, those in more.items() if key in value for pair in those.items()),
        ]
        for key, one in ((key, one) for keys, one in wanted for key in keys.split()):
            name, path = key.rstrip("?"), f"{where}.{key.rstrip('?')}".strip(".")
            if name in value:
                one(value[name], path)
            elif name == key:
                raise ValueError(f"{path} is missing")
        known = [value[key] is not None for key in _TOGETHER if "min" in value and key in value]
        if any(known) and not all(known):
            raise ValueError(f"{where} has some of {', '.join(_TOGETHER)}, and not all of them")

    return check


_COUNTS, _TEXTS = _by_name(_COUNT), _list(_TEXT)
_STATISTICS = {"min mean p50 p95 p99 p999 max": _NUMBER}
_SCANS = {**_STATISTICS, "max_at_s": _NUMBER, "max_cause": _TEXT_OR_NONE}
_OLD = _keys({"total": _KNOWN, "longest": _NUMBER})
_LOST = {"from_s for_s": _KNOWN, "stations": _LIST, "scans_missed": _COUNT}
_LINK = {
    "stations scans polls undetected_frames collisions": _COUNT,
    "mode retries attempts": _COUNT_OR_NONE,
    "timeout_ms healthy_at_s": _NUMBER,
    "bus_load": _KNOWN,
    "scan_time_ms": _keys({**_SCANS, "current": _NUMBER, "after_startup": _keys(_SCANS)}),
    "failed_attempts": _by_name(_COUNTS),
    "station_errors station_error_onsets?": _COUNTS,
    "master_lost?": _list(_keys(_LOST)),
    "refresh_gap_ms": _by_name(_keys({"p50 p99 p999 max": _NUMBER, "open": _KNOWN, "count": _COUNT})),
    # Of an earlier version but the total.
    "stale_ms?": _by_name(lambda value, where: (_OLD if isinstance(value, dict) else _KNOWN)(value, where)),
}
_BUS = {
    "baud frames collisions undetected_frames": _COUNT,
    "format": _TEXT,
    "nodes": _TEXTS,
    "bus_load": _KNOWN,
}
_SCAN = {"scan_ms": _keys({"mean max": _NUMBER})}
_PLC = {"registers": _COUNTS, "own_names?": _by_name(_TEXT), "set_under?": _TEXT, **_SCAN}
_AGE = _keys({"before_refresh on_arrival": _keys({"p50 max": _NUMBER}), "open": _KNOWN})
_POLL = {
    "ok timeouts? turns failed_turns": _COUNT,
    "response_ms": _keys(_STATISTICS),
    "late_ms": _keys({"max": _NUMBER}),
    "age_ms": lambda value, where: None if value is None else _AGE(value, where),
}
_MASTER = {
    "ok answered_with_own_data? timeouts crc_errors mismatched_responses late_responses?": _COUNT,
    "exceptions other_errors": _COUNTS,
    "timeout_ms": _NUMBER,
    "response_ms": _keys(_STATISTICS),
    "cycle_ms": _keys({**_STATISTICS, "count": _COUNT}),
    "polls": _by_name(_keys({"transactions": _COUNT, **_POLL})),
}
_SLAVE = {"station": _COUNT_OR_NONE, "answered": _COUNT, "exceptions rejected": _COUNTS}
_FREE = {"received timeouts damaged": _COUNT, "messages?": _COUNTS, "bytes": _keys({"sent received": _COUNT})}
_NODE = {"transactions? sent? requests?": _COUNT, "bus": _TEXT}
_node = partial(_keys, transactions=_MASTER, sent=_FREE, requests=_SLAVE)
_LATENCY = {
    "from to kind": _TEXT,
    "edge": _one_of(None, "rising", "falling", "both"),
    "way": _TEXT_OR_NONE,
    "inverted": _FLAG,
    "changes delivered lost unseen open": _COUNT,
    "ms": _keys(_STATISTICS),
    "max_at_s reads? lost_short? longest_gap_ms?": _NUMBER,
    "parts_ms": _keys({" ".join(PARTS): _keys({"mean max": _NUMBER})}),
    "way_reasons bound_reasons? bound_notes?": _TEXTS,
    "comments?": _by_name(_TEXT),
    "bound_ms?": _by_name(_KNOWN),
}
_RESTS = {"inputs figures": _by_name(_origin), "assumptions text": _TEXTS}
#: Raises ValueError with the first key of a summary that is missing, or holds what it may not.
check_summary = _keys(
    {
        "bussim scenario": _TEXT,
        "seed": _COUNT,
        "duration_s": _KNOWN,
        "links": _by_name(_keys(_LINK)),
        "buses": _by_name(_keys(_BUS)),
        "plcs": _by_name(_keys(_PLC)),
        "ports": _by_name(_node({**_NODE, "protocol": _TEXT_OR_NONE, "errors": _COUNTS})),
        "devices": _by_name(
            _node({**_NODE, "model": _TEXT, "requests broadcasts": _COUNT, "state": _OBJECT})
        ),
        "latency?": _by_name(_keys(_LATENCY)),
        "warnings": _TEXTS,
        "rests_on?": _keys({"links?": _by_name(_keys(_RESTS))}),
        "verdict?": _list(_keys({"key text": _TEXT, "values": _keys({"bus?": _TEXT})})),
    }
)
