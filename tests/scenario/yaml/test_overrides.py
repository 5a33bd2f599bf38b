"""``--set key.path=value``."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from bussim.devices.free.model import FreeSettings
from bussim.devices.free.scripted import Message
from bussim.devices.stepper.model import StepperSettings
from bussim.errors import ScenarioError, UsageError
from bussim.plc.profiles import AbsentStation
from bussim.scenario import fault_kinds, model
from bussim.scenario.loader import load, loads
from bussim.scenario.model import Scenario
from bussim.scenario.yaml.overrides import Override
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND
from tests.scenario.port_samples import PORTS
from tests.scenario.samples import BASE, added

MS = TICKS_PER_MS
NOISY = added("noise:\n  - {bus: link, ber: 1e-6}\n  - {name: drive, bus: link, ber: 1e-5}\n")


def _set(*overrides: str, text: str = NOISY) -> Scenario:
    return loads(text, "x.yaml", overrides)


def test_the_same_value_changes_nothing() -> None:
    assert _set("duration=10 s", "plcs.press1.nn.slaves=2") == loads(NOISY)


def test_list_elements_go_by_name_or_position() -> None:
    assert _set("plcs.press1.nn.retries=2").plcs[0].registers["D8179"] == 2
    assert _set("plcs.0.nn.retries=2").plcs[0].registers["D8179"] == 2
    assert _set("noise.0.ber=1e-5").noise[0].kind == model.BitErrors(1e-5)
    assert _set("noise.drive.ber=1e-3").noise[1].kind == model.BitErrors(1e-3)


def test_later_ones_win() -> None:
    assert _set("seed=1", "seed=2").seed == 2


def test_missing_keys_are_made() -> None:
    found = _set("plcs.press2.phase=2 ms", "plcs.press2.sources.D32.constant=7").plcs[1]
    assert found.phase == 2 * MS
    assert list(found.sources) == ["D32"]


def test_shorthands_are_written_out() -> None:
    found = _set("plcs.press1.scan.jitter=1 ms", "plcs.press1.profile.base=fx2n").plcs[0]
    assert found.scan == model.Scan(8 * MS, MS)
    text = NOISY.replace("scan: 8 ms", "scan: 8 ms\n    profile: fx3u")
    found = _set("plcs.press1.profile.absent_station=probe", text=text).plcs[0]
    assert (found.profile.name, found.profile.absent_station) == ("fx3u", AbsentStation.PROBE)
    fault = _set("faults.0.lose_char.index=4", text=added("faults: [{lose_char: press2}]\n")).faults[0]
    assert fault.kind == fault_kinds.LoseChar("press2", fault_kinds.Direction.TX, None, 4)


def test_values_are_yaml() -> None:
    found = _set("noise=[{bus: link, ber: 0.5}, {bus: link, reply_loss: 0x1}]", "name='7E1'")
    assert [entry.kind for entry in found.noise] == [model.BitErrors(0.5), model.ReplyLoss(1.0)]
    assert found.name == "7E1"
    assert (
        _set("faults=[{wrong_format: {station: press2, format: 8E1}}]").faults[0].name
        == "wrong_format press2"
    )


def test_the_source_says_what_was_run() -> None:
    assert _set("seed=99", "duration=1 h").source["seed"] == 99
    assert _set("duration=1 h").source["duration"] == "3600 s"


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("seed", "--set seed: expected key.path=value, such as plcs.press1.nn.retries=2"),
        ("=5", "--set =5: expected key.path=value, such as plcs.press1.nn.retries=2"),
        (
            "sed=5",
            "--set sed=5: sed is not a key here; allowed are schema, name, duration, seed, buses, plcs, devices, noise, faults, observe, latency, warnings, allow_unsimulated; did you mean seed?",
        ),
        (
            "plcs.press9.nn.retries=2",
            "--set plcs.press9.nn.retries=2: plcs has no press9; did you mean press3?",
        ),
        (
            "plcs.7.nn.retries=2",
            "--set plcs.7.nn.retries=2: plcs has no 7; allowed are press1, press2, press3",
        ),
        (
            "plcs.press1.nn.retires=2",
            "--set plcs.press1.nn.retires=2: plcs.press1.nn.retires is not a key here; allowed are bus, port, station, slaves, mode, retries, timeout; did you mean retries?",
        ),
        (
            "plcs.press1.sorce.D0.counter=1 s",
            "--set plcs.press1.sorce.D0.counter=1 s: plcs.press1.sorce is not a key here; allowed are name, profile, scan, phase, nn, registers, ports, polls, sources, program, inputs, comments; did you mean sources?",
        ),
        ("seed.x=2", "--set seed.x=2: seed is 1, which has no keys of its own"),
        ("faults.0.at=5 s", "--set faults.0.at=5 s: faults has no entry 0; it is empty"),
        ("name=[", "--set name=[: "),
        ("a" * 5000 + "=1", "--set aaaa"),
        (".".join("a" * 50) + "=1", "--set a.a.a"),
    ],
)
def test_a_path_that_leads_nowhere(override: str, message: str) -> None:
    text = NOISY + "seed: 1\nfaults: []\n"
    with pytest.raises(UsageError) as caught:
        _set(override, text=text)
    assert str(caught.value).startswith(message)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(
    ("override", "message"),
    [
        (
            "plcs.press1.nn.retries=12",
            "--set plcs.press1.nn.retries=12: plcs.press1.nn.retries is 12, allowed 0..10",
        ),
        ("duration=", "--set duration=: duration is empty, expected a time such as 8 ms"),
        (
            "plcs.press2.nn={bus: lnk, station: 1}",
            (
                "--set plcs.press2.nn={bus: lnk, station: 1}: "
                "plcs.press2.nn.bus is 'lnk', which is no bus; did you mean link?"
            ),
        ),
        (
            "plcs.press2.registers.D8176=5",
            (
                "--set plcs.press2.registers.D8176=5: "
                "plcs.press2.registers.D8176 is 5, but nn.station makes it 1"
            ),
        ),
    ],
)
def test_a_wrong_value_is_a_mistake_at_the_option(override: str, message: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        _set(override)
    assert [str(problem) for problem in caught.value.problems] == [message]


def test_mistakes_of_the_file_keep_their_positions() -> None:
    with pytest.raises(ScenarioError) as caught:
        loads(NOISY.replace("slaves: 2", "slaves: 9"), "x.yaml", ["plcs.press1.nn.retries=11"])
    assert [str(problem) for problem in caught.value.problems] == [
        "--set plcs.press1.nn.retries=11: plcs.press1.nn.retries is 11, allowed 0..10",
        "x.yaml:9:53: nn.slaves is 9, allowed 1..7",
    ]


def test_a_value_from_another_option_has_its_own_label(tmp_path: Path) -> None:
    file = tmp_path / "x.yaml"
    file.write_text(BASE, encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"--duration 5: duration is 5, a time without a unit"):
        load(file, [Override("duration", "5", "--duration 5")])
    assert load(file, [Override("duration", "5 s", "--duration 5 s")]).duration == 5 * TICKS_PER_SECOND


def test_ports_polls_and_devices() -> None:
    def found(*overrides: str) -> Scenario:
        return loads(PORTS, "x.yaml", overrides)

    assert found("plcs.press1.ports.COM3.timeout=250 ms").plcs[0].registers["D7929"] == 25
    assert found("plcs.press1.polls.0.retries=2").plcs[0].polls[0] == dataclasses.replace(
        loads(PORTS).plcs[0].polls[0],
        retries=2,  # type: ignore[call-arg] # the first is a PollSpec
    )
    named = PORTS.replace("{port: COM3, station: 1", "{name: where, port: COM3, station: 1")
    (poll, _) = loads(named, "x.yaml", ["plcs.press1.polls.where.every=2 s"]).plcs[0].polls
    assert poll.every == 2 * TICKS_PER_SECOND
    assert found("devices.drive.delay=50ms").devices[0].delay == 50 * MS
    changed = found("devices.reader.says.0.every=3 s", 'devices.reader.says.0.text="BC"').devices[1].settings
    assert changed == FreeSettings((Message(b"BC", every=3 * TICKS_PER_SECOND),))
    assert found("devices.drive.registers.pitch=700").devices[0].settings == StepperSettings(
        registers={"pitch": 700}
    )


def test_mistakes_of_ports_polls_and_devices_are_named_in_full() -> None:
    def message(override: str) -> str:
        with pytest.raises((ScenarioError, UsageError)) as caught:
            loads(PORTS, "x.yaml", [override])
        return str(caught.value).removeprefix(f"--set {override}: ")

    assert message("devices.driv.delay=50ms") == "devices has no driv; did you mean drive?"
    assert message("devices.drive.delay=20ms") == (
        "devices.drive.delay is 20 ms, but a stepper responds no sooner than 35 ms"
    )
    assert message("plcs.press1.ports.COM3.timeout=55 ms") == (
        "plcs.press1.ports.COM3.timeout is 55 ms, allowed are multiples of 10 ms, here 50 ms or 60 ms"
    )
    assert message("plcs.press1.polls.0.count=126") == (
        "plcs.press1.polls.0.count is 126, allowed 1..125 (function 3)"
    )
    assert message("devices.drive.dely=20ms") == "devices.drive.dely is not a key here; did you mean delay?"
