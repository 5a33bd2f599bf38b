"""A scenario back into YAML."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import TYPE_CHECKING

from bussim.errors import UsageError
from bussim.scenario.model import Scenario
from bussim.scenario.yaml.parser import core_scalar
from bussim.units import format_time
from bussim.wording import RawFloat, RawInt

if TYPE_CHECKING:
    from yaml import SafeDumper, ScalarNode


def dumps(scenario: Scenario) -> str:
    """The scenario as YAML with every default filled in; the same text for the same scenario.

    Loading the text gives an equal scenario. Name, duration and seed are the scenario's own, also
    where ``dataclasses.replace`` changed them after loading. Raises UsageError for a scenario that
    no loader made, which has no form to be written in.
    """
    if not scenario.source:
        raise UsageError(
            f"scenario {scenario.name!r} was not loaded; make it with from_data to write it as YAML"
        )
    changed = {"name": scenario.name, "duration": format_time(scenario.duration), "seed": scenario.seed}
    return dumped({**scenario.source, **changed})


def dumped(data: Mapping[str, object]) -> str:
    """Plain data as YAML; the same text for the same data, in the order of their keys."""
    # The library leaves no choice between block and flow style but by depth: one line an entry of a list.
    return _dump(data, flow=None, width=110)


def dumped_inline(value: object) -> str:
    """A plain value as YAML in one line, lists and mappings in brackets and braces."""
    return _dump(value, flow=True, width=inf).removesuffix("\n").removesuffix("\n...")


def _dump(data: object, *, flow: bool | None, width: float) -> str:
    import yaml

    class Dumper(yaml.SafeDumper):
        """A class of its own: what it learns is not for other users of the library."""

    Dumper.add_representer(str, _text)
    Dumper.add_representer(RawInt, _number)
    Dumper.add_representer(RawFloat, _number)
    return yaml.dump(
        data, Dumper=Dumper, default_flow_style=flow, sort_keys=False, allow_unicode=True, width=width
    )


def _number(dumper: SafeDumper, number: RawInt | RawFloat) -> ScalarNode:
    kind = "int" if isinstance(number, int) else "float"
    return dumper.represent_scalar(f"tag:yaml.org,2002:{kind}", number.raw)


def _text(dumper: SafeDumper, text: str) -> ScalarNode:
    """A text; one of several lines (a program) as a block, unless it has what a block cannot hold."""
    plain = "\n" in text and text.replace("\n", "").replace("\t", "").isprintable()
    # Read by YAML 1.2, numbers have more forms than the library knows.
    bare = not text.startswith((":", "?")) and isinstance(core_scalar(text), str)
    style = "|" if plain else None if bare else "'"
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)
