"""What is wrong or odd about observed devices and latencies."""

from bussim.forms.fields import PlcPoint
from bussim.plc.memory import parse_device
from bussim.scenario.resolve.members import Member
from bussim.scenario.resolve.scenario import Resolved
from bussim.scenario.schema.draft import Entry, readable
from bussim.scenario.schema.programs import LatencyIn
from bussim.scenario.yaml.source_map import Path, Report


def check_observed(resolved: Resolved, report: Report) -> None:
    """Check that each device is one of its PLC's profile; warn of one that is observed twice."""
    members = {member.name: member for member in resolved.members}
    seen: set[PlcPoint] = set()
    for index, point in enumerate(resolved.draft.observe):
        _check_device(("observe", index), point, members.get(point.plc), report)
        if point in seen:
            report.warn(("observe", index), f"{point} is observed twice")
        seen.add(point)


def _check_device(path: Path, point: PlcPoint, member: Member | None, report: Report) -> None:
    if member is not None:
        try:
            parse_device(str(point.device), observed=True, family=member.profile.family)
        except ValueError as error:
            report.error(path, f"is {point}, whose device {error}")


def check_latencies(resolved: Resolved, report: Report) -> None:
    """Check every entry of ``latency``."""
    by_name = {member.name: member for member in resolved.members}
    for entry, given in readable(resolved.draft.latency):
        source, target = (by_name.get(point.plc) for point in (given.from_, given.to))
        if source is not None and target is not None:
            _check_latency(entry, given, source, target, report)


def _check_latency(
    entry: Entry[LatencyIn], given: LatencyIn, source: Member, target: Member, report: Report
) -> None:
    start, end, path = given.from_, given.to, entry.path
    _check_device((*path, "from"), start, source, report)
    _check_device((*path, "to"), end, target, report)
    if start.device.is_word != end.device.is_word:
        kinds = [f"{point} is a {'word' if point.device.is_word else 'bit'}" for point in (start, end)]
        report.error((*path, "to"), f"is {end}: {' and '.join(kinds)}, but a latency has two of a kind")
        return
    if start == end:
        report.error((*path, "to"), f"is {end}, the device that it comes from")
        return
    if end.device.letter == "X":
        report.error((*path, "to"), f"is {end}, an input: no program can set it")
        return
    if source.unread or target.unread:
        return
    if source is not target and (source.bus is None or source.bus != target.bus):
        report.error((*path, "to"), f"is {end}, but {start.plc} and {end.plc} share no N:N link")
        return
    if start.device.is_word:
        for key in ("edge", "inverted"):
            if getattr(given, key) is not None:
                report.error((*path, key), f"has no meaning for words, and {start} is one", key=True)
        if source is target:
            report.error((*path, "to"), f"is {end}, of the same PLC: there is no age to measure")
            return
    if start.device.letter == "X" and str(start.device) not in source.logic.inputs:
        report.warn(
            (*path, "from"), f"nothing drives {start}: it has no entry in the inputs of the PLC {source.name}"
        )
