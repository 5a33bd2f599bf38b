"""The outputs that README and guide show are those of the commands that they name.

A comment ``<!-- output: COMMAND | head -N -->`` stands above each. After a change of what a command prints,
``python -m tests.guide.test_outputs`` writes them anew; read the difference before committing it.
"""

from __future__ import annotations

import io
import os
import re
import shlex
import tempfile
from contextlib import chdir, redirect_stderr, redirect_stdout
from functools import cache
from pathlib import Path

import pytest

from bussim.cli import main
from bussim.scenario import builtin
from tests.guide.pages import EVERY, blocks, name, page, read
from tests.undrawn import undrawn

SHOWN = re.compile(
    r"<!-- output: bussim (.+?)(?: \| (head|tail) -(\d+))? -->\n```text\n(.*?)```\n", re.DOTALL
)


@cache
def recording() -> dict[str, bytes]:
    """The recording of a noisy line, and the scenario that is fitted to it."""
    with tempfile.TemporaryDirectory() as folder, chdir(folder), undrawn(), redirect_stdout(io.StringIO()):
        main(["run", "electrical_noise", "--trace", "--out", "run"])
        main(["export", "run", "--to", "sr", "-o", "line.sr"])
        main(["fit", "line.sr", "-o", "fitted.yaml"])
        return {file: Path(file).read_bytes() for file in ("line.sr", "fitted.yaml")}


@cache
def printed(command: str) -> str:
    """What a command prints, in a folder that holds the copy of the tutorial with one bad value.

    A command that names the recording or the scenario fitted to it has them there; the readout and the
    calibration are those of their page.
    """
    out = io.StringIO()
    with tempfile.TemporaryDirectory() as folder, chdir(folder), undrawn():
        bad = builtin.read("press_line").replace("retries: 5", "retries: 12")
        Path("my_line.yaml").write_text(bad, encoding="utf-8")
        for file in set(shlex.split(command)[1:2]) & {"line.sr", "fitted.yaml"}:
            Path(file).write_bytes(recording()[file])
        for file, text in zip(
            ("readout.yaml", "calibration.yaml"), blocks(page("site"), "yaml"), strict=True
        ):
            Path(file).write_text(text, encoding="utf-8")
        with redirect_stdout(out), redirect_stderr(out):
            main(shlex.split(command))
    return out.getvalue()


def shown(command: str, end: str, lines: str) -> str:
    """The first or last lines of what a command prints, or all of them, without blanks at their ends."""
    part = slice(-int(lines), None) if end == "tail" else slice(int(lines) if lines else None)
    kept = printed(command).splitlines()[part]
    return "".join(f"{line.rstrip()}\n" for line in kept)


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, marks=pytest.mark.slow) if "line.sr" in read(path) else path
        for path in EVERY
        if SHOWN.search(read(path))
    ],
    ids=name,
)
def test_outputs_are_what_the_commands_print(path: Path) -> None:
    for command, end, lines, text in SHOWN.findall(read(path)):
        assert text == shown(command, end, lines), command


def test_no_output_is_left_unchecked() -> None:
    for path in EVERY:
        text = read(path)
        assert text.count("<!-- output:") == text.count("```text") == len(SHOWN.findall(text)), path


if __name__ == "__main__":
    os.environ.setdefault("COLUMNS", "100")
    for each in EVERY:
        before = read(each)
        after = SHOWN.sub(
            lambda found: found[0].replace(
                f"```text\n{found[4]}", f"```text\n{shown(found[1], found[2] or '', found[3] or '')}"
            ),
            before,
        )
        if after != before:
            each.write_text(after, encoding="utf-8")
