"""What the guide says of the program is what the program does."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

import bussim
from bussim.commands.poll.plan import Planned
from bussim.commands.poll.session import Tally
from bussim.devices.registry import MODELS
from bussim.engines.modbus.pdu import Request
from bussim.engines.modbus.polls import Poll
from bussim.engines.nn.frames import MODES
from bussim.engines.nn.states import MASTER
from bussim.live.wire import WireCounts
from bussim.plc.link_registers import LinkRegisters
from bussim.plc.memory import Memory
from bussim.plc.profiles import PROFILES
from bussim.plc.program.text.catalog import SPECS
from bussim.plc.program.text.specials import SPECIAL_BITS
from bussim.results.store.rows import FORMS
from bussim.scenario.loader import load, loads
from bussim.scenario.schema.disturbances import FaultIn, NoiseIn
from bussim.scenario.schema.document import NNIn
from bussim.scenario.schema.profiles import ProfileIn
from bussim.scenario.schema.programs import InputIn, LatencyIn
from tests.engines.diagrams import mermaid
from tests.guide.pages import blocks, page, quoted, table
from tests.scenario.port_samples import more
from tests.scenario.samples import mistakes

#: Link times of the FX communication manual (JY992D69901, N:N network), ms, by number of stations.
PUBLISHED = {
    2: (18, 22, 34),
    3: (26, 32, 50),
    4: (33, 42, 66),
    5: (41, 52, 83),
    6: (49, 62, 99),
    7: (57, 72, 115),
    8: (65, 82, 131),
}


def link(stations: int, mode: int, profile: str) -> str:
    settings = f"bus: link, port: COM4, station: 0, slaves: {stations - 1}, mode: {mode}"
    plcs = [f"  - {{name: p0, profile: {profile}, scan: 8 ms, nn: {{{settings}}}}}"]
    plcs += [
        f"  - {{name: p{k}, profile: {profile}, scan: 8 ms, nn: {{bus: link, port: COM4, station: {k}}}}}"
        for k in range(1, stations)
    ]
    lines = ["schema: 1", "name: table", "duration: 5 s", "seed: 1", "buses:", "  - {name: link, nn: true}"]
    return "\n".join([*lines, "plcs:", *plcs])


def simulated_mean(stations: int, mode: int, profile: str = "pw10") -> float:
    summary = bussim.run(loads(link(stations, mode, profile)), rows=False).summary
    return float(summary["links"]["link"]["scan_time_ms"]["mean"])


def table_row(stations: int) -> str:
    cells = [f"{PUBLISHED[stations][mode]} | {simulated_mean(stations, mode):.1f}" for mode in range(3)]
    return f"| {stations} | {' | '.join(cells)} |"


@pytest.mark.parametrize("profile", ["pw10", "fx2n"])
@pytest.mark.parametrize("stations", PUBLISHED)
def test_published_link_times(stations: int, profile: str) -> None:
    for mode, published in enumerate(PUBLISHED[stations]):
        assert abs(simulated_mean(stations, mode, profile) - published) <= 0.65


@pytest.mark.parametrize("stations", PUBLISHED)
def test_link_time_table(stations: int) -> None:
    assert table_row(stations) in page("model")


def test_master_diagram() -> None:
    assert mermaid(MASTER) in page("model")


def test_the_blocks_of_the_stations() -> None:
    rows = table(page("model"), "D8178 |")
    assert [row[0] for row in rows] == ["0", "1", "2", "3 (PW10)", "4 (PW10)"]
    assert [(int(row[1].replace("none", "0")), int(row[2])) for row in rows] == [
        (block.bits, block.words) for block in MODES
    ]
    blocks = {name: LinkRegisters(profile, Memory()).range_of(1, 2) for name, profile in PROFILES.items()}
    assert (blocks["pw10"].bit, blocks["pw10"].bits, blocks["pw10"].word, blocks["pw10"].words) == (
        1064,
        64,
        32,
        8,
    )
    assert {blocks[name].word for name in ("fx2n", "fx3u", "fx1s")} == {10}
    assert {name for name, profile in PROFILES.items() if 3 in profile.modes} == {"pw10"}


def test_example_scenario_is_sound() -> None:
    assert loads(blocks(page("scenario"), "yaml")[0]).warnings == ()


def test_every_other_example_of_the_scenario_reference_is_tried_below() -> None:
    assert len(blocks(page("scenario"), "yaml")) == 3
    assert len(blocks(page("programs"), "yaml")) == 1


def test_the_examples_of_ports_and_devices_load() -> None:
    _, ports, devices = blocks(page("scenario"), "yaml")
    devices = devices.removeprefix("devices:\n")
    more = ports.replace("buses:\n", "buses:\n  - {name: ovens}\n  - {name: belt}\n")
    found = loads(f"schema: 1\nname: readme\nduration: 5 s\n{more}{devices}")
    assert [device.model for device in found.devices] == ["stepper", "map", "stepper", "hmi", "free"]
    assert [poll.name for poll in found.plcs[0].polls] == ["COM3 station 1 03 @22", "COM3 station 1 05 @7"]
    summary = bussim.run(found, rows=False).summary
    assert summary["ports"]["press1.COM3"]["timeouts"] == 0
    assert summary["devices"]["reader"]["sent"] == 5


def test_the_example_of_a_program_loads_and_its_signal_arrives() -> None:
    (example,) = blocks(page("programs"), "yaml")
    link = '  - {name: feeder, nn: {bus: link, port: COM4, station: 0, slaves: 1, mode: 1}, program: "LD M1064\\nOUT Y4\\nEND"}\n'
    text = "schema: 1\nname: page\nduration: 20 s\nbuses: [{name: link, nn: true}]\n" + example.replace(
        "plcs:\n", f"plcs:\n{link}"
    )
    (found,) = bussim.run(loads(text), rows=False).summary["latency"].values()
    assert found["delivered"] > 5


def test_the_instructions_are_those_of_the_catalog() -> None:
    """Contacts that compare are documented by three examples."""
    rows = re.findall(
        r"^\| (contacts|coils|words|bits|order|ports) \| (.*) \|$", page("programs"), re.MULTILINE
    )
    documented = {name for _, row in rows for part in re.findall(r"`([^`]*)`", row) for name in part.split()}
    compared = {name for name, spec in SPECS.items() if spec.group == "comparison"}
    assert documented - compared == set(SPECS) - compared
    assert documented & compared


def test_every_input_of_the_table_can_be_read(tmp_path: Path) -> None:
    shown = re.findall(r"`(\{(?:pulse|square|random|times|csv): .*?\})`", page("programs"))
    kinds = set(InputIn.model_fields)
    assert {text[1:].split(":")[0] for text in shown} == kinds
    (tmp_path / "edges.csv").write_text("time_s,level\n1,1\n", encoding="utf-8")
    inputs = "".join(f"      X{number:o}: {text}\n" for number, text in enumerate(shown))
    text = f"schema: 1\nname: x\nduration: 1 s\nplcs:\n  - name: a\n    inputs:\n{inputs}"
    (tmp_path / "x.yaml").write_text(text, encoding="utf-8")
    assert len(load(tmp_path / "x.yaml").plcs[0].inputs) == len(shown)


def test_the_special_bits_that_are_left_out_are_documented() -> None:
    row = next(line for line in page("programs").split("\n") if line.startswith("| left out"))
    documented: set[int] = set()
    for first, last in re.findall(r"M(8\d{3})(?:–M(8\d{3}))?", row):
        documented |= set(range(int(first), int(last or first) + 1))
    assert documented == set(SPECIAL_BITS)


def test_the_keys_of_a_latency_are_documented() -> None:
    keys = {info.alias or name for name, info in LatencyIn.model_fields.items()}
    assert keys == {
        key for row in table(page("programs"), "`latency:`") for key in re.findall(r"`(\w+)", row[0])
    }


def test_the_keys_of_a_poll_s_summary_are_documented() -> None:
    (row,) = (line for line in page("results").splitlines() if line.startswith("| `poll --json` |"))
    tally = Tally(Planned(Poll(1, Request(3, 0, 1)), "p", 0, None))
    assert {*tally.to_json(), *WireCounts().to_json()} <= set(re.findall(r"`(\w+)`", row))


@pytest.mark.parametrize(
    ("heading", "known"),
    [
        ("noise |", set(NoiseIn.kinds)),
        ("fault |", set(FaultIn.kinds)),
        ("device | what it is", set(MODELS)),
        ("key of `nn`", set(NNIn.model_fields)),
        ("field |", set(ProfileIn.model_fields) - {"base"}),
    ],
)
def test_the_scenario_reference_is_complete(heading: str, known: set[str]) -> None:
    documented = [key for row in table(page("scenario"), heading) for key in quoted(row[0])]
    assert sorted(documented) == sorted(known)


@pytest.mark.parametrize("form", FORMS.values(), ids=lambda form: form.stem)
def test_every_column_of_a_table_is_described(form: Any) -> None:
    rows = page("results").split(f"`{form.stem}.csv`:\n\n")[1].split("\n\n")[0].split("\n")[2:]
    documented = [name for row in rows for name in quoted(row.split("|")[1])]
    assert sorted(documented) == sorted(form.columns.kinds)


def test_the_table_of_faults_says_at_what_each_can_happen() -> None:
    """Of a device, as ``drive`` is in the sample, what the table gives PLCs only is refused."""
    values = {
        "power_on": "{drive: 1 s}",
        "slow": "{station: drive, extra: 1 ms}",
        "cable_cut": "{bus: line, after: drive}",
        "wrong_format": "{station: drive, baud: 4800}",
        "clock_ppm": "{station: drive, ppm: 10}",
        "late_release": "{station: drive, by: 1 us}",
        "pause": "{station: drive, by: 1 ms}",
        "flip_bits": "{station: drive, bits: [4]}",
        "board_error": "{plc: drive, port: COM3, code: 40}",
    }
    for row in table(page("scenario"), "fault"):
        for kind in quoted(row[0]):
            said = mistakes(more(f"faults:\n  - {{{kind}: {values.get(kind, 'drive')}}}\n"))
            assert bool(said) == (row[1] == "PLC" or "plc" in row[1]), kind
