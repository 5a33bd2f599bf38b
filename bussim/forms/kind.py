"""A kind of values that a key takes: how it is read, written back, and described as JSON Schema.

The patterns are ECMAScript's, whose classes know ASCII alone: what a pattern leaves open, letters of other
scripts above all, is decided by what reads the value.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from bussim.units import UNIT_TICKS

#: A JSON Schema.
Form = Mapping[str, Any]

_UNITS = "|".join((*UNIT_TICKS, "\N{GREEK SMALL LETTER MU}s"))
TEXT_FORM: Form = {"type": "string"}
TIME_FORM: Form = {
    "type": "string",
    "pattern": rf"^\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{{1,2}})?\s*({_UNITS})\s*$",
}
#: A text that YAML may have read as a number.
UNREAD_FORM: Form = {"type": ["string", "number"]}
#: A character format such as 7E1, which is 70 to YAML.
FORMAT_FORM: Form = {
    "type": ["string", "number"],
    "pattern": r"^\s*[78]\s*-?\s*[NEOneo]\s*-?\s*[12]\s*$",
    "minimum": 70,
    "maximum": 800,
}
#: A name, of what is no sign of ASCII but _ and -.
NAME_PATTERN = r"(?!-)(?=.*[^\x00-@\[-`{-\x7f])[^\s\x00-,./:-@\[-\^`{-\x7f]{1,64}"


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of values: how the file's is checked and read, and how ours is written back.

    ``form`` takes all that is right, and as little else as it can; without it anything.
    """

    read: Callable[[object], object]
    write: Callable[[Any], object] | None = None
    form: Form = field(default_factory=dict, compare=False)

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        """What pydantic asks an annotation for."""
        serialization = None
        if self.write is not None:
            serialization = core_schema.plain_serializer_function_ser_schema(self.write)
        return core_schema.no_info_plain_validator_function(self.read, serialization=serialization)

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """What pydantic asks it for to describe it."""
        return dict(self.form)
