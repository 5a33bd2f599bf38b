"""Files that are not text, not there, too large or too clever."""

from __future__ import annotations

from pathlib import Path

import pytest

from bussim.errors import Problem, ScenarioError
from bussim.scenario.loader import examine, load, loads
from bussim.scenario.yaml import parser as yaml
from tests.scenario.samples import BASE


def _only_mistake(path: Path) -> str:
    with pytest.raises(ScenarioError) as caught:
        load(path)
    (problem,) = caught.value.problems
    return str(problem).replace(str(path), "FILE")


def test_a_good_file(tmp_path: Path) -> None:
    file = tmp_path / "good.yaml"
    file.write_text(BASE, encoding="utf-8")
    assert load(file) == load(str(file)) == loads(BASE)
    examined = examine(file)
    assert examined.errors == examined.warnings == ()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "FILE: is empty; a scenario begins with schema: 1"),
        (b"\n\n   \n", "FILE: is empty; a scenario begins with schema: 1"),
        (b"\x00\x01\x02", "FILE:1:1: the character U+0000 does not belong in text; is it a binary file?"),
        (b"a: b\n\x7fELF", "FILE:2:1: the character U+007F does not belong in text; is it a binary file?"),
        (b"\xff\xfea\x00:\x00", "FILE:1:1: is UTF-16 text; save the file as UTF-8"),
        (
            "schema: 1\nname: Förderband\n".encode("latin-1"),
            "FILE:2:8: the byte 0xF6 is not UTF-8 text; save the file as UTF-8 (is it in GBK, Big5, Shift-JIS or Latin-1?)",
        ),
        (
            b"\x89PNG\r\n\x1a\n",
            "FILE:1:1: the byte 0x89 is not UTF-8 text; save the file as UTF-8 (is it in GBK, Big5, Shift-JIS or Latin-1?)",
        ),
        (b"# " + b"x" * (1 << 20), "FILE: is larger than 512 KiB, too much for a scenario"),
        (b"[" * 500_000, "FILE:1:31: nested deeper than 30 levels"),
        (b"{a: " * 100_000, "FILE:1:121: nested deeper than 30 levels"),
        (b"- " * 100_000, "FILE:1:61: nested deeper than 30 levels"),
    ],
)
def test_a_file_that_is_no_scenario(tmp_path: Path, content: bytes, message: str) -> None:
    file = tmp_path / "bad.yaml"
    file.write_bytes(content)
    assert _only_mistake(file) == message
    assert [str(problem).replace(str(file), "FILE") for problem in examine(file).errors] == [message]


def test_a_directory(tmp_path: Path) -> None:
    assert _only_mistake(tmp_path) == "FILE: is a folder, not a scenario file"


def test_a_missing_file_with_the_nearest_built_in_name() -> None:
    assert _only_mistake(Path("pres_line")) == (
        "FILE: no such file, and no built-in scenario of that name; did you mean press_line?"
    )


def test_a_path_that_cannot_be_one() -> None:
    with pytest.raises(ScenarioError):
        load("a\0b")
    with pytest.raises(ScenarioError):
        load("x" * 5000)


def test_a_file_without_an_end_is_not_read(tmp_path: Path) -> None:
    zero = Path("/dev/zero")
    if not zero.exists():
        pytest.skip("no /dev/zero on this system")
    assert _only_mistake(zero) == "FILE: is a device of the system, not a scenario file"
    large = tmp_path / "large.yaml"
    large.write_text("# much\n" * (1 << 17))
    assert _only_mistake(large) == "FILE: is larger than 512 KiB, too much for a scenario"


def test_byte_order_mark_and_line_ends_change_nothing(tmp_path: Path) -> None:
    file = tmp_path / "windows.yaml"
    file.write_bytes(b"\xef\xbb\xbf" + BASE.replace("\n", "\r\n").encode())
    assert load(file) == loads(BASE)
    changed = BASE.replace("slaves: 2", "slaves: 9").replace("\n", "\r\n")
    file.write_bytes(b"\xef\xbb\xbf" + changed.encode())
    assert _only_mistake(file) == "FILE:9:53: nn.slaves is 9, allowed 1..7"


def test_aliases_are_bounded_before_they_cost_anything() -> None:
    levels = 'a: &a ["x"]\n' + "".join(
        f"{name}: &{name} [{', '.join([f'*{before}'] * 9)}]\n"
        for before, name in zip("abcdefgh", "bcdefghi", strict=True)
    )
    data, _, problems = yaml.read(levels, "bomb")
    assert data is None
    assert [problem.message for problem in problems] == [
        "more than 50000 keys and values, aliases expanded; too much for a scenario"
    ]


def test_merge_keys_are_bounded_too() -> None:
    first = "a: &a {" + ", ".join(f"k{i}: 1" for i in range(1000)) + "}\n"
    rest = "".join(f"b{i}: {{<<: *a}}\n" for i in range(100))
    _, _, problems = yaml.read(first + rest, "bomb")
    assert problems == [Problem("bomb", 25, 11, problems[0].message)]
    assert problems[0].message.startswith("more than 50000 keys and values")


def test_depth_is_counted_through_aliases() -> None:
    text = "a: &a " + "[" * 20 + "]" * 20 + "\nb: " + "[" * 15 + "*a" + "]" * 15 + "\n"
    _, _, problems = yaml.read(text, "deep")
    assert [str(problem) for problem in problems] == ["deep:2:19: nested deeper than 30 levels"]
