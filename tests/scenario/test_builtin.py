"""The scenarios that come with bussim."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from bussim.errors import UsageError
from bussim.scenario import builtin, fault_kinds
from bussim.scenario.loader import examine, load

#: Those whose point is something that the loader warns of.
ODD = {
    "bad_parameter",
    "same_number_twice",
    "eight_stations_mode3",
    "eight_stations_mode4",
    "two_masters",
    "timeout_too_short",
    "foreign_block",
    "manual_programs",
    # They take bits of other stations without asking for the error flags.
    "interlock",
    "counter_preset",
    "power_dips",
}


def test_the_default_is_first_and_there_are_enough() -> None:
    names = builtin.names()
    assert names[0] == builtin.DEFAULT == "press_line"
    assert names[1:] == sorted(names[1:])
    assert len(names) >= 28


@pytest.mark.parametrize("name", builtin.names())
def test_each_loads_and_says_what_to_look_at(name: str) -> None:
    examined = examine(builtin.path(name))
    assert examined.errors == ()
    assert bool(examined.warnings) == (name in ODD)
    lines = builtin.read(name).splitlines()
    assert lines[0].startswith("# ")
    assert builtin.title(name) == lines[0][2:]
    assert "Look at:" in builtin.read(name).partition("schema:")[0]


@pytest.mark.parametrize("name", builtin.names())
def test_the_commands_in_the_comments_work(name: str) -> None:
    """Every ``--set`` that a comment suggests can be loaded."""
    import shlex

    for line in builtin.read(name).splitlines():
        words = shlex.split(line[1:]) if line.startswith("#   bussim run") else []
        settings = [after for before, after in itertools.pairwise(words) if before == "--set"]
        if settings:
            assert words[2] == name
            load(name, settings)


def test_the_eight_stations_are_eight_in_every_mode() -> None:
    for mode in range(5):
        scenario = load(f"eight_stations_mode{mode}")
        assert len(scenario.plcs) == 8
        assert scenario.plcs[0].registers["D8178"] == mode


def test_the_corruption_is_one_that_parity_and_sum_miss() -> None:
    from bussim.engines.nn.frames import decode, encode_data

    scenario = load("undetected_corruption")
    (fault,) = scenario.faults
    assert isinstance(fault.kind, fault_kinds.FlipBits)
    sent = encode_data(1, 9, bytes([0, 3, 0, 0, 0, 0, 0, 0])).chars
    heard = bytearray(sent)
    for bit in fault.kind.bits:
        character, index = divmod(bit, 10)
        assert 1 <= index <= 7  # a data bit
        heard[character] ^= 1 << (index - 1)
    assert all(
        before.bit_count() % 2 == after.bit_count() % 2 for before, after in zip(sent, heard, strict=True)
    )
    frame = decode(bytes(heard))
    assert frame is not None
    assert frame.data == bytes([0x30, 0, 0, 0, 0, 0, 0, 0])


def test_an_unknown_name() -> None:
    with pytest.raises(UsageError, match=r"no built-in scenario 'two_station'; did you mean two_stations\?"):
        builtin.path("two_station")
    assert builtin.path("two_stations") == builtin.path("two_stations.yaml")


def test_a_file_wins_over_a_built_in_name_and_that_over_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert builtin.locate("two_stations") == (builtin.path("two_stations"), "two_stations.yaml")
    Path("two_stations").mkdir()
    assert load("two_stations").name == "two stations"
    Path("bursts").write_text(builtin.read("two_stations").replace("two stations", "mine"), encoding="utf-8")
    assert load("bursts").name == "mine"
    assert builtin.locate("bursts") == (Path("bursts"), "bursts")
    assert builtin.locate("./bursts") == (Path("bursts"), "./bursts")


def test_the_wheel_carries_the_same_folder() -> None:
    import tomllib

    settings = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))
    included = settings["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    assert included == {"scenarios": "bussim/scenario/builtin"}
    assert builtin._FOLDERS[0] == Path(builtin.__file__).parent / "builtin"
