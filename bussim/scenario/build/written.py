"""A part of a scenario as the file has it."""

from __future__ import annotations

from typing import Any

from bussim.scenario.schema.form import Model


def as_written(model: Model) -> dict[str, Any]:
    """A mapping as the file has it: times as text, keys by their names in the file."""
    return model.model_dump(by_alias=True, exclude_none=True)


def in_order(model: Model, written: dict[str, Any]) -> dict[str, object]:
    """The keys in the order of the form, wherever their values came from."""
    order = [info.alias or name for name, info in type(model).model_fields.items()]
    return {key: written[key] for key in order if key in written}
