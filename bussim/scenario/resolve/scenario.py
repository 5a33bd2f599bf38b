"""A draft with everything resolved that its entries say of each other."""

from dataclasses import dataclass

from bussim.scenario.resolve.buses import Line, lines_of
from bussim.scenario.resolve.members import Member, member_of
from bussim.scenario.resolve.nodes import Directory
from bussim.scenario.schema.draft import Draft, readable, values_of
from bussim.scenario.yaml.files import Files
from bussim.scenario.yaml.source_map import Report
from bussim.scenario.yaml.user_code import Code


@dataclass(frozen=True, slots=True)
class Resolved:
    """What the rules check and the builder builds from. What could not be read is in ``draft`` only.

    ``lines`` are the buses by name, ``members`` the PLCs in their order, ``nodes`` what sits on the buses.
    ``power_on`` are the ticks at which PLCs and devices are switched on, by name, for those that are not
    on from the beginning. ``code`` finds functions of the user.
    """

    draft: Draft
    lines: dict[str, Line]
    members: list[Member]
    nodes: Directory
    power_on: dict[str, int]
    code: Code

    @property
    def duration(self) -> int | None:
        """The length of the run in ticks; None if it could not be read."""
        return self.draft.document.duration if self.draft.document is not None else None


def resolve(draft: Draft, code: Code, files: Files, report: Report) -> Resolved:
    """Read the files that a draft names, find bus, profile and ports of each entry, report mistakes."""
    lines = lines_of(draft.buses)
    power_on: dict[str, int] = {}
    for fault in values_of(draft.faults):
        power_on.update(fault.power_on or {})
    members = [
        member_of(entry.path, plc, lines, power_on.get(plc.name, 0), files, report, skips=draft.skips)
        for entry, plc in readable(draft.plcs)
    ]
    return Resolved(draft, lines, members, Directory(draft, members, lines), power_on, code)
