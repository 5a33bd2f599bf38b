"""Whatever a file holds: mistakes, never anything else."""

from __future__ import annotations

import contextlib
import json
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bussim.devices.free.model import MessageIn
from bussim.devices.map.model import ItemIn
from bussim.devices.registry import MODELS, form_of
from bussim.errors import ScenarioError, UsageError
from bussim.scenario.loader import from_data, load, loads
from bussim.scenario.model import Scenario
from bussim.scenario.schema.disturbances import FaultIn, NoiseIn
from bussim.scenario.schema.document import BusIn, DocumentIn, NNIn, PlcIn, PortIn
from bussim.scenario.schema.polls import PollIn
from bussim.scenario.schema.profiles import ProfileIn
from tests.scenario.port_samples import FULL_PORTS
from tests.scenario.test_loader import FULL

# Anything at all.

_KEYS = sorted(
    {
        info.alias or name
        for form in (
            *(DocumentIn, BusIn, PlcIn, PortIn, PollIn, ProfileIn, NNIn, NoiseIn, FaultIn, ItemIn, MessageIn),
            *(form_of({"model": name}) for name in MODELS),
        )
        for name, info in form.model_fields.items()
    }
    | {"mean", "jitter", "station", "bits", "D8176", "M8179", "COM4", "toggle", "ramp", "<<", "", "values"}
)

#: How long an example takes is no verdict.
PATIENT = settings(suppress_health_check=[HealthCheck.too_slow])


_SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=8),
    st.sampled_from(
        ["link", "press1", "8 ms", "50ms", "COM4", "pw10", "7E1", "tx", "10 y", "1e99 y", "-1 s"]
    ),
)


_ANYTHING = st.recursive(
    _SCALARS,
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.sampled_from(_KEYS) | st.text(max_size=4), inner, max_size=6)
    ),
    max_leaves=25,
)


def _only_scenario_errors(data: Any) -> None:
    with contextlib.suppress(ScenarioError):
        assert isinstance(from_data(data), Scenario)


@PATIENT
@given(_ANYTHING)
def test_random_structures_raise_only_scenario_errors(data: object) -> None:
    _only_scenario_errors(data)


@PATIENT
@given(st.data())
def test_good_scenarios_with_anything_at_one_position_raise_only_scenario_errors(draw: st.DataObject) -> None:
    data = json.loads(json.dumps(loads(draw.draw(st.sampled_from([FULL, FULL_PORTS]))).source))
    node: Any = data
    while True:
        keys = list(node) if isinstance(node, dict) else list(range(len(node)))
        key = draw.draw(st.sampled_from(keys))
        inner = node[key]
        if not isinstance(inner, dict | list) or not inner or draw.draw(st.booleans()):
            break
        node = inner
    node[key] = draw.draw(_ANYTHING)
    if isinstance(node, dict) and draw.draw(st.booleans()):
        node[draw.draw(st.sampled_from(_KEYS))] = draw.draw(_ANYTHING)
    _only_scenario_errors(data)


@PATIENT
@given(st.text() | st.text("schema: 1\n-{}[]&*!|>%@`'\"#,?~<=\tabc", max_size=80))
def test_random_text_raises_only_scenario_errors(text: str) -> None:
    with contextlib.suppress(ScenarioError):
        loads(text)


@PATIENT
@given(
    st.sampled_from([FULL, FULL_PORTS]), st.integers(0, len(FULL) - 1), st.text(max_size=3), st.integers(0, 5)
)
def test_damaged_scenarios_raise_only_scenario_errors(text: str, at: int, put: str, cut: int) -> None:
    with contextlib.suppress(ScenarioError):
        loads(text[:at] + put + text[at + cut :])


@PATIENT
@given(st.binary(max_size=60))
def test_random_bytes_raise_only_scenario_errors(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    file = tmp_path_factory.mktemp("bytes") / "x.yaml"
    file.write_bytes(content)
    with contextlib.suppress(ScenarioError):
        load(file)


@PATIENT
@given(st.text(max_size=40), st.text(max_size=20))
def test_random_overrides_raise_only_our_errors(key: str, value: str) -> None:
    for override in (
        f"{key}={value}",
        f"plcs.press1.{key}={value}",
        f"devices.sensors.registers.0.value={value}",
    ):
        with contextlib.suppress(ScenarioError, UsageError):
            loads(FULL_PORTS, overrides=[override])


def test_every_kind_of_noise_and_fault_is_in_the_full_example() -> None:
    source = loads(FULL).source
    noise, faults = source["noise"], source["faults"]
    assert isinstance(noise, list)
    assert isinstance(faults, list)
    assert {key for entry in noise for key in entry} >= set(NoiseIn.kinds)
    assert {key for entry in faults for key in entry} >= {*FaultIn.kinds, "power_on"}
