"""The distribution of a link scan and the stations' chances of error, for any noise."""

from __future__ import annotations

from bussim.exact.bursts.scan_chain import ScanChain
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
        self._chain: ScanChain | None = None
        self._distribution: Distribution | None = None
        self._fails: tuple[Fails, ...] | None = None

    @property
    def chain(self) -> ScanChain:
        """The chain from scan to scan."""
        if self._chain is None:
            self._chain = ScanChain(self.model)
        return self._chain

    @property
    def distribution(self) -> Distribution:
        """The distribution of the link scan time, in ticks."""
        if self._distribution is None:
            self._distribution = (
                scan_distribution(self.model) if self.model.noise.memoryless else self.chain.distribution()
            )
        return self._distribution

    @property
    def fails(self) -> tuple[Fails, ...]:
        """Each station's chances of being in error, in order."""
        if self._fails is None:
            model = self.model
            if model.noise.memoryless:
                self._fails = tuple(
                    fails_of(probabilities, model.attempts, model.absent)
                    for probabilities in probabilities_of(model)
                )
            else:
                self._fails = self.chain.fails()
        return self._fails
