"""A scenario back into YAML."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from bussim.errors import UsageError
from bussim.scenario.model import Scenario
from bussim.units import format_time

if TYPE_CHECKING:
    from ruamel.yaml.nodes import ScalarNode
    from ruamel.yaml.representer import SafeRepresenter


def dumps(scenario: Scenario) -> str:
    """The scenario as YAML with every default filled in; the same text for the same scenario.

    Loading the text gives an equal scenario. Name, duration and seed are the scenario's own, also
    where ``dataclasses.replace`` changed them after loading. Raises UsageError for a scenario that
    no loader made, which has no form to be written in.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.representer import SafeRepresenter

    class Representer(SafeRepresenter):
        """A class of its own: what it learns is not for other users of ruamel."""

    if not scenario.source:
        raise UsageError(
            f"scenario {scenario.name!r} was not loaded; make it with from_data to write it as YAML"
        )
    data = {
        **scenario.source,
        "name": scenario.name,
        "duration": format_time(scenario.duration),
        "seed": scenario.seed,
    }
    # ruamel leaves no choice between block and flow style but by depth: one line an entry of a list.
    yaml = YAML(typ="safe", pure=True)
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment] # typed as None by mistake
    yaml.default_flow_style = None
    yaml.allow_unicode = True
    yaml.width = 110
    Representer.add_representer(str, _text)
    yaml.Representer = Representer
    text = io.StringIO()
    yaml.dump(data, text)
    return text.getvalue()


def _text(representer: SafeRepresenter, text: str) -> ScalarNode:
    """A text; one of several lines (a program) as a block, unless it has what a block cannot hold."""
    plain = "\n" in text and text.replace("\n", "").replace("\t", "").isprintable()
    # ruamel writes a text that begins so bare, and cannot read it again within braces.
    style = "|" if plain else "'" if text.startswith((":", "?")) else None
    return representer.represent_scalar("tag:yaml.org,2002:str", text, style=style)
