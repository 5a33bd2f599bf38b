"""Random streams: one generator for each thing that is random, named after it.

Every stream is seeded from the scenario's seed and its own name alone, so that adding a station or
a noise changes no other draws, in any process and any order of creation.
"""

from __future__ import annotations

from collections.abc import Callable
from hashlib import blake2b
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    import numpy as np

_FIRST_BLOCK = 32
_BLOCK = 1024


class Uniforms:
    """Endless numbers, uniform in [0, 1), which can be looked at before they are taken.

    They are drawn in blocks, on whose sizes they do not depend; ``make`` makes their generator at the first.
    """

    __slots__ = ("_at", "_bound", "_clear", "_drawn", "_generator", "_hit", "_make", "_numbers")

    def __init__(self, make: Callable[[], np.random.Generator]) -> None:
        self._make = make
        self._generator: np.random.Generator | None = None
        self._drawn: Any = None  # an array; what lies before _at is taken
        self._numbers: list[float] = []  # the same, as far as single ones were asked for
        self._at = 0
        # None from _at to _clear lies below _bound; _hit: whether the number at _clear does.
        self._bound, self._clear, self._hit = 0.0, 0, False

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> float:
        at = self._at
        try:
            number = self._numbers[at]
        except IndexError:
            self._reach(1)
            self._numbers = self._drawn.tolist()
            at = self._at
            number = self._numbers[at]
        self._at = at + 1
        return number

    def _reach(self, count: int) -> None:
        """Draw until so many numbers are there that were not taken."""
        if self._drawn is None:
            self._generator = self._make()
            self._drawn = self._generator.random(_FIRST_BLOCK)
        missing = self._at + count - len(self._drawn)
        if missing > 0 and self._generator is not None:
            import numpy as np

            fresh = self._generator.random(max(missing, _BLOCK))
            self._drawn = np.concatenate((self._drawn[self._at :], fresh))
            self._numbers = []
            self._hit = self._hit and self._clear >= self._at
            self._clear = max(0, self._clear - self._at)
            self._at = 0

    def ahead(self, count: int) -> np.ndarray:
        """The next numbers, which are not taken."""
        self._reach(count)
        return self._drawn[self._at : self._at + count]  # type: ignore[no-any-return] # an array, once reached

    def skip(self, count: int) -> None:
        """Take so many numbers."""
        self._reach(count)
        self._at += count

    def before(self, bound: float, most: int) -> int:
        """How many numbers come before the next one below ``bound``, counted up to ``most``."""
        if bound != self._bound or self._clear < self._at:
            self._bound, self._clear, self._hit = bound, self._at, False
        while not self._hit and self._clear - self._at < most:
            if self._clear == (0 if self._drawn is None else len(self._drawn)):
                self._reach(self._clear - self._at + 1)
            part = self._drawn[self._clear :] < bound
            first = int(part.argmax())
            self._hit = bool(part[first])
            self._clear += first if self._hit else len(part)
        return min(self._clear - self._at, most)


class Streams:
    """The random streams of one run."""

    def __init__(self, seed: int) -> None:
        self.seed = seed

    def generator(self, *name: str | int) -> np.random.Generator:
        """A numpy generator of its own for a name (its parts in order)."""
        import numpy as np

        text = "\x1f".join(str(part) for part in name)
        digest = blake2b(text.encode("utf-8"), digest_size=16).digest()
        return np.random.Generator(
            np.random.PCG64(np.random.SeedSequence([self.seed, int.from_bytes(digest, "big")]))
        )

    def uniforms(self, *name: str | int) -> Uniforms:
        """Endless numbers, uniform in [0, 1)."""
        return Uniforms(lambda: self.generator(*name))
