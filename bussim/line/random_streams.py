"""Random streams: one generator for each thing that is random, named after it.

Every stream is seeded from the scenario's seed and its own name alone, so that adding a station or
a noise changes no other draws, in any process and any order of creation.
"""

from __future__ import annotations

from collections.abc import Iterator
from hashlib import blake2b
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

_FIRST_BLOCK = 32
_BLOCK = 1024


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

    def uniforms(self, *name: str | int) -> Iterator[float]:
        """Endless numbers, uniform in [0, 1), drawn in blocks."""
        generator = self.generator(*name)
        yield from generator.random(_FIRST_BLOCK).tolist()
        while True:
            yield from generator.random(_BLOCK).tolist()
