"""Every device model of the registry is whole: one that is made by halves fails here."""

from __future__ import annotations

import pkgutil
from collections.abc import Iterator
from copy import deepcopy
from importlib import import_module
from pathlib import Path
from typing import Any, get_args

import pytest
import yaml

import bussim.devices
from bussim.devices.contract import FreeProtocolSettings, MasterSettings, SlaveSettings
from bussim.devices.forms import DeviceIn
from bussim.devices.registry import MODELS, UnknownDeviceIn, form_of
from bussim.errors import ScenarioError
from bussim.exact.polls.from_scenario import poll_lists
from bussim.forms.form import Model
from bussim.scenario.loader import from_data
from bussim.scenario.model import Scenario
from bussim.scenario.yaml.dump import dumps
from bussim.serve.targets import serve_targets
from tests.sim.build import Done, run

ROOT = Path(__file__).parents[2]
#: The other node of the bus, by the kind of the model.
PARTNERS = {
    "slave": {
        "name": "partner",
        "model": "hmi",
        "polls": [{"station": 9, "function": 3, "address": 0, "every": "100 ms"}],
    },
    "master": {"name": "partner", "model": "v80", "station": 9},
    "free protocol": {"name": "partner", "model": "v80", "station": 9},
}
KINDS = {"slave": SlaveSettings, "master": MasterSettings, "free protocol": FreeProtocolSettings}


def form(name: str) -> type[DeviceIn]:
    return form_of({"model": name})


def example(name: str) -> dict[str, Any]:
    """The model's own example of an entry: with every key that it adds, and none at its default."""
    found: dict[str, Any] = yaml.safe_load(form(name).example)
    assert isinstance(found, dict), f"{name}: its form has no example"
    return found


def scenario(name: str, device: dict[str, Any] | None = None) -> Scenario:
    device = example(name) if device is None else device
    partner = {**PARTNERS[form(name).role], "bus": "feeder", "mode": device.get("mode", "rtu")}
    return from_data(
        {
            "schema": 1,
            "name": "one device",
            "duration": "5 s",
            "buses": [{"name": "feeder", "baud": 9600, "format": "8N1"}],
            "plcs": [],
            "devices": [device, partner],
        }
    )


def keys(form: type[Model]) -> set[str]:
    """All keys of a form, those of the mappings within it too."""
    found: set[str] = set()
    for name, info in form.model_fields.items():
        found |= {info.alias or name}
        todo = [info.annotation]
        for annotation in todo:  # which grows
            todo += get_args(annotation)
            if isinstance(annotation, type) and issubclass(annotation, Model):
                found |= keys(annotation)
    return found


def paths(value: Any, *path: Any) -> Iterator[tuple[Any, ...]]:
    """Where the keys of an example stand."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield (*path, key)
            yield from paths(inner, *path, key)
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from paths(inner, *path, index)


def without(value: Any, path: tuple[Any, ...]) -> Any:
    """A copy that lacks one key."""
    copy = deepcopy(value)
    inner = copy
    for part in path[:-1]:
        inner = inner[part]
    del inner[path[-1]]
    return copy


def test_every_form_of_a_model_is_in_the_registry() -> None:
    for module in pkgutil.walk_packages(bussim.devices.__path__, "bussim.devices."):
        import_module(module.name)
    kinds = [DeviceIn]
    for kind in kinds:  # which grows
        kinds += kind.__subclasses__()
    concrete = {kind for kind in kinds if not kind.__abstractmethods__}
    assert concrete == {UnknownDeviceIn, *map(form, MODELS)}


@pytest.mark.parametrize("name", MODELS)
def test_its_form_names_it(name: str) -> None:
    found = form(name)
    assert issubclass(found, DeviceIn)
    assert found is not UnknownDeviceIn
    assert found.port.name == name
    assert example(name)["model"] == name
    assert example(name).get("station") == (9 if found.role == "slave" else None)


@pytest.mark.parametrize("name", MODELS)
def test_its_example_has_every_key(name: str) -> None:
    """But those of every device, the function of a user, and the mode of what has one only."""
    known = keys(form(name)) - {"baud", "format", "call"}
    if len(form(name).port.modes) == 1:
        known.discard("mode")
    assert known <= {path[-1] for path in paths(example(name))}


@pytest.mark.parametrize("name", MODELS)
def test_every_key_reaches_the_frozen_device(name: str) -> None:
    whole = scenario(name).devices[0]
    for path in paths(example(name)):
        try:
            less = scenario(name, without(example(name), path))
        except ScenarioError:
            continue  # it cannot be left out
        assert less.devices[0] != whole, path


@pytest.mark.parametrize("name", MODELS)
def test_its_settings_are_of_the_kind_that_its_form_says(name: str) -> None:
    assert isinstance(scenario(name).devices[0].settings, KINDS[form(name).role])


@pytest.mark.parametrize("name", MODELS)
def test_its_canonical_form_has_every_key_and_reads_as_the_same(name: str) -> None:
    found = scenario(name)
    written = found.source["devices"][0]  # type: ignore[index]
    assert set(written) >= set(example(name))
    again = from_data(found.source)
    assert again == found
    assert dumps(again) == dumps(found)


@pytest.mark.parametrize("name", MODELS)
def test_it_acts_on_its_bus(name: str) -> None:
    done: Done = run(scenario(name))
    device = example(name)["name"]
    match form(name).role:
        case "slave":
            totals = next(found for found in done.totals.devices if found.name == device)
            assert totals.requests > 10
            assert totals.answered == totals.requests
        case "master":
            assert {record.outcome for record in done.record.transactions} == {"ok"}
        case "free protocol":
            assert any(record.node == device for record in done.record.said)


@pytest.mark.parametrize("name", MODELS)
def test_the_exact_solver_knows_it(name: str) -> None:
    """A slave's response times are those of the run; a list of a master has figures."""
    found = scenario(name)
    device = example(name)["name"]
    lists = poll_lists(found)
    match form(name).role:
        case "slave":
            assert lists["partner"].valid, lists["partner"].obstacles
            (poll,) = lists["partner"].polls
            assert poll.device == device
            records = run(found).record.transactions
            times = [
                record.answer_end - record.sent
                for record in records
                if record.sent is not None and record.answer_end is not None
            ]
            assert len(times) > 10
            assert poll.response_end.least <= min(times) <= max(times) <= poll.response_end.most
        case "master":
            assert lists[device].valid, lists[device].obstacles
        case "free protocol":
            assert lists == {}


@pytest.mark.parametrize("name", MODELS)
def test_it_can_be_served(name: str) -> None:
    target = next(found for found in serve_targets(scenario(name)) if found.node == example(name)["name"])
    assert form(name).role in target.what
    assert not target.why_not


@pytest.mark.parametrize("name", MODELS)
def test_the_manual_has_a_row_for_it(name: str) -> None:
    pages = (ROOT / "bussim" / "guide").glob("*.md")
    assert any(f"\n| `{name}` |" in page.read_text(encoding="utf-8") for page in pages)
