"""Watches that whatever is wrong or odd in a scenario can be said in Chinese, while other tests make mistakes."""

import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from bussim.errors import Problem
from bussim.words.formats import render
from bussim.words.tables import Said

#: Tests whose scenarios and programs have mistakes of all kinds.
_WATCHED = ("tests/scenario/", "tests/plc/", "tests/devices/", "tests/ui/", "tests/commands/test_check.py")
#: What a user, the system or Python says, a command to type, and names that Unicode gives to rare characters.
_NAMES = re.compile(
    r"'(?:[^'\\]|\\.)*'|\"(?:[^\"\\]|\\.)*\"|\{[^}]*\}|\([^)]*\)|（[^）]*）|\w*Error: .*|不能读：.*|bussim scenarios",
    re.DOTALL,
)


def english_in(text: str) -> list[str]:
    """Words of English, two or more in a row, in a mistake as a Chinese page shows it."""
    shown = render(text.key, text.values, "zh") if isinstance(text, Said) else text
    return re.findall(r"[a-z][a-z']+(?: [a-z][a-z']+)+", _NAMES.sub("", shown.partition("；请写 ")[0]))


@contextmanager
def watched() -> Iterator[None]:
    """Fail the test under way that has bussim say what is wrong in English alone."""
    made = Problem.__init__

    def watch(self: Problem, *args: Any, **kwargs: Any) -> None:
        made(self, *args, **kwargs)
        module = sys._getframe(1).f_globals["__name__"]
        test = os.environ.get("PYTEST_CURRENT_TEST", "")
        if module.startswith("bussim.") and test.startswith(_WATCHED):
            assert isinstance(self.message, Said), f"without a key: {self.message}"
            assert not english_in(self.message), self.message

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Problem, "__init__", watch)
        yield
