"""The exceptions of bussim.

::

    BussimError
    ├── ScenarioError      the user's input is wrong; carries every mistake found (exit code 2)
    │   └── ProgramError   the same of a PLC's program
    ├── UsageError         a command or API call cannot be done as asked (exit code 2)
    └── RunError           a correct request failed while it ran (exit code 1)

Noise on a line is never an exception: damaged bytes are events of an engine.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field


class BussimError(Exception):
    """Base of everything that bussim raises on purpose."""


@dataclass(frozen=True, slots=True, order=True)
class Problem:
    """One mistake or warning at one position of an input file.

    ``file`` is the name as the user gave it; ``line`` and ``column`` count from 1 and are 0 where
    the input has no such position (a whole file, an object built in Python). ``path`` is the key that it
    is about, as ``--set`` takes it, "" for none.
    """

    file: str
    line: int
    column: int
    message: str
    path: str = field(default="", compare=False)

    def __str__(self) -> str:
        if self.line == 0:
            return f"{self.file}: {self.message}"
        return f"{self.file}:{self.line}:{self.column}: {self.message}"


class ScenarioError(BussimError):
    """A scenario that cannot be simulated. ``problems`` holds every mistake, in file order."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems: tuple[Problem, ...] = tuple(sorted(problems))
        super().__init__("\n".join(str(problem) for problem in self.problems))


class ProgramError(ScenarioError):
    """A PLC program that cannot be run. ``problems`` holds every mistake, in the order of its lines."""


class UsageError(BussimError):
    """A request that cannot be carried out as asked: an existing folder, an unknown name."""


class RunError(BussimError):
    """A correct request failed while it was being carried out."""
