"""Parts of a simulation on which no link acts: PLCs that do not read its blocks, with their serial buses.

What they do between two frames of a link does not depend on those frames, so it may be done afterwards: many
link scans pass at once meanwhile (:mod:`bussim.sim.nn.block_path`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from bussim.plc.plc import Plc
from bussim.sim.kernel import Timer


@dataclass
class Part:
    """PLCs that serial buses join, and the timers of theirs and of their buses."""

    plcs: list[Plc] = field(default_factory=list)
    timers: list[Timer] = field(default_factory=list)

    @property
    def is_independent(self) -> bool:
        """Whether no link acts on it as its PLCs are set now."""
        return all(plc.is_independent for plc in self.plcs)


def parts(
    plcs: Mapping[str, tuple[Plc, Timer | None]], buses: Sequence[tuple[Sequence[str], Sequence[Timer]]]
) -> list[Part]:
    """The parts that have timers: PLCs by name with the timers of their ENDs, buses with their PLCs."""
    found = {name: Part([plc], [timer] if timer is not None else []) for name, (plc, timer) in plcs.items()}
    for names, timers in buses:
        joined = Part(timers=list(timers))
        for part in {id(found[name]): found[name] for name in names}.values():
            joined.plcs += part.plcs
            joined.timers += part.timers
        for plc in joined.plcs:
            found[plc.name] = joined
        if not joined.plcs:
            found[f"bus {len(found)}"] = joined
    return [part for part in {id(part): part for part in found.values()}.values() if part.timers]
