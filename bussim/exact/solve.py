"""The distribution of a link scan and the stations' chances of error, for any noise."""

from functools import cached_property

import numpy as np

from bussim.exact.bursts.listening import NOTHING, memory_of
from bussim.exact.bursts.scan_chain import ScanChain
from bussim.exact.bursts.timeout_stacks import TimeoutStacks
from bussim.exact.link import LinkModel
from bussim.exact.scan.memoryless import Fails, fails_of, probabilities_of, scan_distribution
from bussim.exact.scan.mixture import Distribution


class Solved:
    """One link with one setting, worked out when asked.

    Raises ValueError for a link whose closed form does not hold (see :attr:`LinkModel.reasons`):
    there is no number to be had, rather than a wrong one.
    """

    def __init__(self, model: LinkModel) -> None:
        if not model.valid:
            raise ValueError("; ".join(model.reasons))
        self.model = model
        self._chains: dict[int, ScanChain] = {}

    @cached_property
    def chain(self) -> ScanChain:
        """The chain from scan to scan."""
        return ScanChain(self.model)

    @cached_property
    def stacks(self) -> TimeoutStacks:
        """The moments of its exchanges."""
        return TimeoutStacks(self.model, np.full(1, float(self.model.timeout)))

    def chain_of(self, receiver: int) -> ScanChain:
        """The chain with what a receiver remembers of the link's frames, if that matters."""
        if memory_of(self.model, receiver) is NOTHING:
            return self.chain
        if receiver not in self._chains:
            self._chains[receiver] = ScanChain(self.model, receiver)
        return self._chains[receiver]

    @cached_property
    def distribution(self) -> Distribution:
        """The distribution of the link scan time, in ticks."""
        return scan_distribution(self.model) if self.model.noise.memoryless else self.chain.distribution()

    @cached_property
    def fails(self) -> tuple[Fails, ...]:
        """Each station's chances of being in error, in order."""
        model = self.model
        if not model.noise.memoryless:
            return self.chain.fails()
        return tuple(fails_of(each, model.attempts, model.absent) for each in probabilities_of(model))
