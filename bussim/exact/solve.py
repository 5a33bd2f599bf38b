"""The law of a link scan and the stations' chances of error, for any noise that can be worked out."""

from __future__ import annotations

from bussim.exact.bursts.scan_chain import ScanChain
from bussim.exact.link import LinkModel
from bussim.exact.scan.memoryless import Fails, fails_of, odds_of, scan_law
from bussim.exact.scan.mixture import Law


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
        self._law: Law | None = None
        self._fails: tuple[Fails, ...] | None = None

    @property
    def chain(self) -> ScanChain:
        """The chain from scan to scan."""
        if self._chain is None:
            self._chain = ScanChain(self.model)
        return self._chain

    @property
    def law(self) -> Law:
        """The law of the link scan time, in ticks."""
        if self._law is None:
            self._law = scan_law(self.model) if self.model.noise.memoryless else self.chain.law()
        return self._law

    @property
    def fails(self) -> tuple[Fails, ...]:
        """Each station's chances of being in error, in order."""
        if self._fails is None:
            model = self.model
            if model.noise.memoryless:
                self._fails = tuple(fails_of(odds, model.attempts, model.absent) for odds in odds_of(model))
            else:
                self._fails = self.chain.fails()
        return self._fails
