"""What every mapping of a scenario file has in common."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from enum import StrEnum
from fractions import Fraction
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self, TypeVar

from pydantic import BaseModel, ConfigDict, GetJsonSchemaHandler, ValidationInfo, model_validator
from pydantic_core import CoreSchema

from bussim.forms.fields import Time, exact, fail, time
from bussim.forms.kind import Form
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND
from bussim.words.language import say

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")


class Model(BaseModel):
    """A mapping of the file: no unknown keys, nothing converted."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, defer_build=True)

    #: What the message says where something else stands.
    example: ClassVar[str] = ""
    #: The key that a plain value in place of the mapping stands for.
    shorthand: ClassVar[str | None] = None
    #: The JSON Schema of a plain value in place of the mapping, where that is not the key's.
    plain_form: ClassVar[Form | None] = None
    #: What stands for keys that it must have where they are missing or wrong, while the rest is checked.
    stand_ins: ClassVar[dict[str, object]] = {}

    @model_validator(mode="before")
    @classmethod
    def _expand(cls, value: Any) -> Any:
        if cls.shorthand is not None and isinstance(value, str | int | float) and not isinstance(value, bool):
            return {cls.shorthand: value}
        return value

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Its JSON Schema: described by its example, with the plain value that may stand for it."""
        named = handler(core)
        form = handler.resolve_ref_schema(named)
        mapping = {key: form[key] for key in form if key not in ("title", "description")}
        plain = cls.plain_form
        if cls.shorthand is not None and {*mapping.get("required", ())} <= {cls.shorthand}:
            plain = mapping["properties"][cls.shorthand]
        form.clear()
        form.update(mapping if plain is None else {"anyOf": [plain, mapping]})
        form["description"] = cls.example.strip()
        return named

    def given(self, *without: str) -> dict[str, Any]:
        """The values that are there, by the names of their fields, without some of these."""
        return {key: value for key, value in self if value is not None and key not in without}


def kinds_of(model: type[Model], common: type[Model]) -> tuple[str, ...]:
    """The keys of which an entry has exactly one: all but those of ``common``, which it extends."""
    return tuple(key for key in model.model_fields if key not in common.model_fields)


def only_one(model: Model, keys: tuple[str, ...], info: ValidationInfo) -> None:
    """Complain unless exactly one of ``keys`` is given.

    None is right where the reading's context says that wrong keys were left out (they may be it).
    """
    given = [key for key in keys if getattr(model, key) is not None]
    if len(given) > 1:
        raise fail(say("form_excludes", given=given[0]), given[1])
    if not given and not info.context:
        raise fail(say("form_says_nothing", keys=", ".join(keys)))


class OneKind(Model):
    """A mapping that has exactly one of its ``kinds``, beside other keys or without."""

    kinds: ClassVar[tuple[str, ...]]

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Its JSON Schema, which takes one kind alone."""
        named = super().__get_pydantic_json_schema__(core, handler)
        form = handler.resolve_ref_schema(named)
        form.get("anyOf", [form])[-1]["oneOf"] = [{"required": [kind]} for kind in cls.kinds]
        return named

    @model_validator(mode="after")
    def _one_kind(self, info: ValidationInfo) -> Self:
        only_one(self, self.kinds, info)
        return self

    @property
    def kind(self) -> str:
        """The one that is given, "" where that was wrong."""
        return next((key for key in self.kinds if getattr(self, key) is not None), "")


def as_written(model: Model, **defaults: object) -> dict[str, Any]:
    """A mapping as the file has it: times as text, keys by their names in the file.

    ``defaults`` are the values of keys that it leaves open.
    """
    return in_order(model, {**defaults, **model.model_dump(by_alias=True, exclude_none=True)})


def in_order(model: Model, written: dict[str, Any]) -> dict[str, Any]:
    """The keys in the order of the form, wherever their values came from."""
    order = [info.alias or name for name, info in type(model).model_fields.items()]
    return {key: written[key] for key in order if key in written}


def changed(base: T, given: Mapping[str, Any]) -> T:
    """A dataclass's instance with some fields as a file gives them, each of the type that it had."""
    return replace(base, **{key: _like(getattr(base, key), value) for key, value in given.items()})


def _like(before: object, given: Any) -> Any:
    match before:
        case Fraction():
            return exact(given)
        case StrEnum():
            return type(before)(given)
        case tuple():
            return tuple(given)
        case _:
            return given


class ScanIn(Model):
    """A scan time."""

    example = "a time, or {mean: 8 ms, jitter: 1 ms}"
    shorthand = "mean"

    mean: Annotated[int, time(TICKS_PER_MS // 10, 10 * TICKS_PER_SECOND)]
    jitter: Time = 0

    @model_validator(mode="after")
    def _jitter_below_mean(self) -> ScanIn:
        if self.jitter >= self.mean:
            raise fail(say("form_below_mean"), "jitter")
        return self
