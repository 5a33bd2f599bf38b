"""The form of a scenario file as JSON Schema, for editors: made of the forms that read it.

It takes every scenario that is read here. What depends on several values, on the range of a time or on a name
that stands elsewhere is left to ``bussim check``.
"""

from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, models_json_schema
from pydantic_core import core_schema

from bussim.devices.forms import DeviceIn, MasterIn
from bussim.devices.registry import MODELS, form_of
from bussim.forms.form import Model, as_written
from bussim.scenario.schema.disturbances import FaultIn, NoiseIn
from bussim.scenario.schema.document import (
    MAX_BUSES,
    MAX_DEVICES,
    MAX_FAULTS,
    MAX_NOISE,
    MAX_PLCS,
    MAX_POLLS,
    BusIn,
    DocumentIn,
    PlcIn,
)
from bussim.scenario.schema.draft import EMPTY_LISTS, EMPTY_MAPPINGS
from bussim.scenario.schema.polls import HmiPollIn, PollIn
from bussim.scenario.schema.programs import MAX_LATENCIES, LatencyIn

#: A list whose entries are read by themselves: its owner, its key, their form and the most of them.
_Section = tuple[type[Model], str, type[Model], int]
_SECTIONS: tuple[_Section, ...] = (
    (DocumentIn, "buses", BusIn, MAX_BUSES),
    (DocumentIn, "plcs", PlcIn, MAX_PLCS),
    (DocumentIn, "devices", DeviceIn, MAX_DEVICES),
    (DocumentIn, "noise", NoiseIn, MAX_NOISE),
    (DocumentIn, "faults", FaultIn, MAX_FAULTS),
    (DocumentIn, "latency", LatencyIn, MAX_LATENCIES),
    (PlcIn, "polls", PollIn, MAX_POLLS),
)


class _Generator(GenerateJsonSchema):
    """Values as the file has them: nothing stands for a key that is not given, defaults have their units."""

    def nullable_schema(self, schema: core_schema.NullableSchema) -> dict[str, Any]:
        """A key is left out, never empty."""
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> dict[str, Any]:
        """The default as it would be written."""
        form, default = self.generate_inner(schema["schema"]), schema.get("default")
        if default in (None, [], {}):
            return form
        write: Any = schema["schema"].get("serialization", {}).get("function")
        if isinstance(default, Model):
            default = as_written(default)
        elif write is not None:
            default = write(default)
        return {"allOf": [form], "default": default} if "$ref" in form else {**form, "default": default}

    def field_title_should_be_set(self, schema: Any) -> bool:
        """A key is its own title."""
        return False


def json_schema() -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of scenario files."""
    devices = {name: form_of({"model": name}) for name in MODELS}
    masters = [form for form in devices.values() if issubclass(form, MasterIn)]
    sections: list[_Section] = [*_SECTIONS, *((form, "polls", HmiPollIn, MAX_POLLS) for form in masters)]
    forms: dict[type[BaseModel], None] = dict.fromkeys([DocumentIn, *devices.values()])
    forms |= dict.fromkeys(form for _, _, form, _ in sections if form is not DeviceIn)
    refs, made = models_json_schema(
        [(form, "validation") for form in forms], schema_generator=_Generator, ref_template="#/$defs/{model}"
    )
    ref = {form: refs[form, "validation"] for form in forms}
    defs: dict[str, Any] = made["$defs"]
    owners: list[type[Model]] = [DocumentIn, PlcIn, *masters]
    keys = {form: defs[ref[form]["$ref"].rpartition("/")[2]]["properties"] for form in owners}
    for owner, key, form, most in sections:
        items = _of_its_model(devices, ref) if form is DeviceIn else ref[form]
        keys[owner][key] |= {"items": items, "maxItems": most}
    keys[PlcIn]["comments"] = {"anyOf": [{"type": "string"}, keys[PlcIn]["comments"]]}
    for properties in (form.get("properties", {}) for form in defs.values()):
        for key in properties.keys() & (EMPTY_LISTS | EMPTY_MAPPINGS):
            if "type" in properties[key]:
                properties[key]["type"] = [properties[key]["type"], "null"]
    document = defs.pop(ref[DocumentIn]["$ref"].rpartition("/")[2])
    some = [
        {"required": [key], "properties": {key: {"type": "array", "minItems": 1}}}
        for key in ("plcs", "devices")
    ]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Scenario of bussim",
        **document,
        "anyOf": some,
        "$defs": defs,
    }


def _of_its_model(devices: dict[str, type[DeviceIn]], ref: dict[type[BaseModel], Any]) -> dict[str, Any]:
    """The form of an entry of ``devices``."""
    has_model = {"type": "object", "required": ["model"]}
    cases = [
        {"if": {**has_model, "properties": {"model": {"const": name}}}, "then": ref[form]}
        for name, form in devices.items()
    ]
    return {**has_model, "properties": {"model": {"enum": list(devices)}}, "allOf": cases}
