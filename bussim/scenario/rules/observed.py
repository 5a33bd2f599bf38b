"""What is wrong or odd about observed devices and latencies."""

from bussim.forms.fields import PlcPoint
from bussim.plc.memory import parse_device
from bussim.scenario.resolve.members import Member
from bussim.scenario.resolve.scenario import Resolved
from bussim.scenario.schema.draft import Entry, readable
from bussim.scenario.schema.programs import LatencyIn
from bussim.scenario.yaml.source_map import Path, Report
from bussim.words.language import say


def check_observed(resolved: Resolved, report: Report) -> None:
    """Check that each device is one of its PLC's profile; warn of one that is observed twice."""
    members = {member.name: member for member in resolved.members}
    seen: set[PlcPoint] = set()
    for index, point in enumerate(resolved.draft.observe):
        _check_device(("observe", index), point, members.get(point.plc), report)
        if point in seen:
            report.warn(("observe", index), say("rule_observed_twice", point=point))
        seen.add(point)


def _check_device(path: Path, point: PlcPoint, member: Member | None, report: Report) -> None:
    if member is not None:
        try:
            parse_device(str(point.device), observed=True, family=member.profile.family)
        except ValueError as error:
            report.error(path, say("rule_whose_device", point=point, error=error.args[0]))


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
        first, second = (
            say("rule_is_a_word" if point.device.is_word else "rule_is_a_bit", point=point)
            for point in (start, end)
        )
        report.error((*path, "to"), say("rule_two_of_a_kind", end=end, first=first, second=second))
        return
    if start == end:
        report.error((*path, "to"), say("rule_same_device", end=end))
        return
    if end.device.letter == "X":
        report.error((*path, "to"), say("rule_end_input", end=end))
        return
    if source.unread or target.unread:
        return
    if source is not target and (source.bus is None or source.bus != target.bus):
        report.error((*path, "to"), say("rule_no_common_link", end=end, plc=start.plc, plc2=end.plc))
        return
    if start.device.is_word:
        for key in ("edge", "inverted"):
            if getattr(given, key) is not None:
                report.error((*path, key), say("rule_words_no_meaning", start=start), key=True)
        if source is target:
            report.error((*path, "to"), say("rule_same_plc", end=end))
            return
    if start.device.letter == "X" and str(start.device) not in source.logic.inputs:
        report.warn((*path, "from"), say("rule_nothing_drives", start=start, source=source.name))
