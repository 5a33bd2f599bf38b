"""What the meters keep as plain data of ``histograms.json``, and back, by its dataclasses' annotations.

A field's key is its name. The metadata of a field may say otherwise: :func:`named`, :data:`FLAT`,
:data:`LATER` and :data:`UNKEPT`. Named tuples and sequences are arrays; counts (whole numbers by name) are
in the order of their names. What has methods ``to_json`` and ``from_json`` is asked.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import Field, fields, is_dataclass
from functools import lru_cache
from types import MappingProxyType, UnionType
from typing import Any, Final, get_args, get_origin, get_type_hints

_hints = lru_cache(get_type_hints)

#: Metadata of a field whose own keys stand among those of the others.
FLAT: Final[Mapping[str, Any]] = MappingProxyType({"flat": True})
#: Metadata of a field that runs of earlier versions lack; it needs a default.
LATER: Final[Mapping[str, Any]] = MappingProxyType({"later": True})
#: Metadata of a field that plain data does not keep: the summary has what follows from it.
UNKEPT: Final[Mapping[str, Any]] = MappingProxyType({"unkept": True})


def named(key: str) -> Mapping[str, Any]:
    """Metadata of a field that has another key than its name."""
    return {"key": key}


def to_plain(value: Any) -> Any:
    """Dataclasses, named tuples, mappings and sequences as what JSON knows."""
    if hasattr(value, "to_json"):
        return value.to_json()
    if is_dataclass(value):
        data: dict[str, Any] = {}
        for field in _kept(value):
            plain = to_plain(getattr(value, field.name))
            data |= plain if "flat" in field.metadata else {field.metadata.get("key", field.name): plain}
        return data
    if isinstance(value, Mapping):
        counts = all(isinstance(each, int) for each in value.values())
        return {str(name): to_plain(value[name]) for name in (sorted(value) if counts else value)}
    return [to_plain(each) for each in value] if isinstance(value, list | tuple) else value


def from_plain(kind: Any, data: Any) -> Any:
    """The value of a type that :func:`to_plain` has made ``data`` of.

    Raises AttributeError, KeyError, TypeError or ValueError for anything else.
    """
    origin, inner = get_origin(kind), get_args(kind)
    if origin is UnionType:
        return None if data is None else from_plain(inner[0], data)
    if origin is Counter:
        return Counter({inner[0](name): int(times) for name, times in data.items()})
    if origin is dict:
        return {inner[0](name): from_plain(inner[1], each) for name, each in data.items()}
    if origin is not None:
        return origin(from_plain(inner[0], each) for each in data)
    if hasattr(kind, "__dataclass_fields__"):
        return kind(**_values(kind, data))
    if hasattr(kind, "_fields"):
        return kind(*(from_plain(hint, each) for hint, each in zip(_hints(kind).values(), data, strict=True)))
    return kind.from_json(data) if hasattr(kind, "from_json") else kind(data)


def _kept(kind: Any) -> list[Field[Any]]:
    return [field for field in fields(kind) if "unkept" not in field.metadata]


def _values(kind: Any, data: Any) -> dict[str, Any]:
    values = {}
    for field in _kept(kind):
        key = field.metadata.get("key", field.name)
        if key in data or "later" not in field.metadata:
            own = data if "flat" in field.metadata else data[key]
            values[field.name] = from_plain(_hints(kind)[field.name], own)
    return values
