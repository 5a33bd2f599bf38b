"""Which lines are served where, and with what rate and format their ports are opened."""

from __future__ import annotations

import pytest

from bussim.errors import UsageError
from bussim.scenario.loader import load, loads
from bussim.serve.targets import serve_targets, targets
from tests.live.rfc2217 import remote
from tests.serve.serving import HEAD, SLAVES, Serving


@pytest.mark.filterwarnings("ignore:set(Daemon|Name):DeprecationWarning")  # pyserial's own
@pytest.mark.parametrize(("baud", "fmt"), [(9600, "8N1"), (19200, "8E1"), (38400, "8O2"), (115200, "7E1")])
def test_a_remote_port_gets_exactly_the_line_of_the_scenario(baud: int, fmt: str) -> None:
    mode = "ascii" if fmt[0] == "7" else "rtu"
    text = f"""{HEAD}
buses: [{{name: line, baud: {baud}, format: {fmt}}}]
plcs: [{{name: plc, scan: 5 ms}}]
devices:
  - name: screen
    model: hmi
    bus: line
    mode: {mode}
    timeout: 100 ms
    polls: [{{name: p, station: 1, function: 3, address: 0, count: 1}}]
"""
    with remote() as (url, fake), Serving(text, ports=(f"screen={url}",)) as serving:
        serving.wait_for(lambda: len(fake.written) >= 8)
    parity = "N" if fmt[0] == "7" else fmt[1]  # which is then in the eighth bit
    wanted = {"baudrate": baud, "bytesize": 8, "parity": parity, "stopbits": int(fmt[2])}
    assert fake.asked == wanted
    assert bytes(fake.written).startswith(b":0\xb103" if mode == "ascii" else b"\x01\x03\x00\x00\x00\x01")


def test_the_link_is_opened_as_the_protocol_wants_it() -> None:
    (target,) = targets(load("two_stations"), ["press"], [])
    assert (target.timing.baud, str(target.timing.format)) == (38400, "7E1")


def test_nodes_of_one_bus_share_a_wire_and_others_do_not() -> None:
    scenario = loads(SLAVES)
    lines = targets(scenario, ["v80", "plc.COM3"], ["oven=pty"])
    assert [(line.name, line.bus, [node.node for node in line.nodes]) for line in lines] == [
        ("line", "line", ["v80", "oven"]),
        ("text outside", "text", ["plc.COM3"]),
    ]
    apart = targets(scenario, [], ["v80=pty:a", "oven=pty:b"])
    assert [(line.name, line.url) for line in apart] == [
        ("line outside", "pty:a"),
        ("line outside 2", "pty:b"),
    ]


def test_a_link_s_port_is_named_by_the_plc_or_by_its_port() -> None:
    scenario = load("nn_with_modbus")
    assert targets(scenario, ["press1.COM4"], []) == targets(scenario, ["press1"], [])
    (line,) = targets(scenario, ["press2", "press3"], [])
    assert line.name == "link"


@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("hmi_on_com2", {"mixer.COM2": "Modbus RTU slave", "screen": "Modbus RTU master"}),
        ("barcode_reader", None),
        ("stepper_positioning", None),
        ("two_stations", {"press": "N:N master", "feeder": "N:N slave 1"}),
    ],
)
def test_what_can_be_served_of_built_in_scenarios(name: str, wanted: dict[str, str] | None) -> None:
    found = serve_targets(load(name))
    assert {one.bus for one in found} == {bus.name for bus in load(name).buses}
    assert all(one.what and (one.what != "silent" or one.why_not) for one in found)
    if wanted is not None:
        assert {one.node: one.what for one in found} == wanted


def test_a_port_that_is_silent_says_why_it_cannot_be_served() -> None:
    text = SLAVES.replace(
        "COM3: {bus: text, protocol: modbus-ascii-slave, station: 5}", "COM2: {bus: text, protocol: hmi}"
    )
    scenario = loads(text)
    with pytest.raises(
        UsageError, match=r"plc.COM2 cannot be served: the protocol of COM2 \(hmi\) is not simulated"
    ):
        targets(scenario, ["plc.COM2"], [])
    with pytest.raises(UsageError) as refused:
        targets(scenario, [], [])
    assert "plc.COM2" not in str(refused.value)
    assert "v80" in str(refused.value)
