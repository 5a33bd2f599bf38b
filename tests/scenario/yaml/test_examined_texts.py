"""A scenario's text from anywhere: what it says of files of this computer, and what it is told of them."""

from __future__ import annotations

from pathlib import Path

import pytest

import bussim
from bussim.scenario import builtin, loader

TABLE = "schema: 1\nname: line\nduration: 1 s\nplcs: [{name: press, inputs: {X0: {csv: FILE}}}]\n"
PROGRAM = "schema: 1\nname: line\nduration: 1 s\nplcs: [{name: press, program: {file: FILE}}]\n"


@pytest.mark.parametrize("name", builtin.names())
def test_as_from_a_file(name: str) -> None:
    path = builtin.path(name)
    files = {file.name: file.read_bytes() for file in path.parent.iterdir() if file.suffix == ".csv"}
    from_file = loader.examine(name)
    assert bussim.examine(builtin.read(name), name=path.name, files=files) == from_file
    assert from_file.scenario is not None


@pytest.mark.parametrize("text", [TABLE, PROGRAM], ids=["table", "program"])
@pytest.mark.parametrize(
    "name", ["SECRET", "beside.csv", "../secret.csv", "link.csv", "./beside.csv", "programs"]
)
def test_no_file_of_this_computer_is_read(
    text: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    for path in (tmp_path / "secret.csv", folder / "beside.csv"):
        path.write_text("the secret of this computer\n")
    (folder / "link.csv").symlink_to(tmp_path / "secret.csv")
    monkeypatch.chdir(folder)
    name = name.replace("SECRET", str(tmp_path / "secret.csv"))
    examined = bussim.examine(text.replace("FILE", name))
    assert examined.scenario is None
    (message,) = [str(problem) for problem in examined.errors if "not given" in str(problem)]
    assert "secret of" not in " ".join(map(str, examined.errors))
    assert message.startswith("<string>:4:")


def test_a_file_that_is_given() -> None:
    good = bussim.examine(TABLE.replace("FILE", "../t.csv"), files={"../t.csv": b"0.5\n0.7\n"})
    assert good.errors == ()
    assert good.get().plcs[0].name == "press"
    near = bussim.examine(TABLE.replace("FILE", "t.csv"), files={"tt.csv": b""})
    assert "did you mean tt.csv?" in str(near.errors[0])
    wrong = bussim.examine(TABLE.replace("FILE", "t.csv"), files={"t.csv": b"0.5\nx\n"})
    assert str(wrong.errors[0]).startswith("t.csv:2:1: ")


def test_functions_of_a_user_are_a_mistake() -> None:
    text = (
        "schema: 1\nname: line\nduration: 1 s\nbuses: [{name: oven}]\n"
        "devices: [{name: meter, model: map, bus: oven, station: 1, "
        "input_registers: [{address: 0, call: os:abort}]}]\n"
    )
    examined = bussim.examine(text)
    assert examined.scenario is None
    assert any("takes --allow-code" in str(problem) for problem in examined.errors), examined.errors
