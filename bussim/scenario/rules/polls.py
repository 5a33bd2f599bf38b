"""What is wrong or odd about polls: whether they can be sent, where their data lie, who answers them."""

from __future__ import annotations

from bussim.devices.forms import MasterIn
from bussim.engines.modbus.adu import BROADCAST
from bussim.engines.modbus.pdu import FUNCTIONS, READS, STANDARD_LIMITS
from bussim.engines.modbus.server import SPACES
from bussim.scenario.resolve.members import Member
from bussim.scenario.resolve.nodes import Directory
from bussim.scenario.resolve.port_configuration import FREE, PortConfiguration
from bussim.scenario.resolve.scenario import Resolved
from bussim.scenario.rules.answers import Answers
from bussim.scenario.rules.poll_data import Placed, check_coils, check_free_data, check_registers
from bussim.scenario.schema.draft import Entry, readable
from bussim.scenario.schema.polls import PollIn, TransactionIn
from bussim.scenario.yaml.source_map import Report
from bussim.wording import suggest

#: Keys of a Modbus poll only, and of a free-protocol one only.
_MODBUS_KEYS = ("station", "function", "address", "from_", "values", "retries")
_FREE_KEYS = ("send", "send_count", "data", "text")


def check_polls(resolved: Resolved, report: Report) -> None:
    """Judge the polls of every PLC and of every device that is a master."""
    answers = Answers(resolved.nodes, resolved.code, report)
    for member in resolved.members:
        for entry, poll in readable(resolved.draft.polls.get(member.path, ())):
            if isinstance(poll, PollIn):
                config = _config(entry, poll, member, resolved.nodes, report)
                if config is not None:
                    place = Placed(member, config, resolved.members)
                    _check_poll(entry, poll, place, resolved.nodes, answers, report)
    for node in resolved.nodes.nodes:
        if not isinstance(node.device, MasterIn):
            continue
        for entry, poll in readable(resolved.draft.polls.get(node.path, ())):
            _check_values(entry, poll, report)
            if _check_request(entry, poll, report):
                answers.check(entry, poll, node, node.device.timeout)


def _config(
    entry: Entry[TransactionIn], poll: PollIn, member: Member, nodes: Directory, report: Report
) -> PortConfiguration | None:
    """The port that drives a poll, if it is one that can."""
    config = next((config for config in member.ports if config.name == poll.port), None)
    usable = [s.name for s in member.ports if s.is_master or s.protocol == FREE]
    if config is not None and config.name in usable:
        return config
    if not nodes.sure(member.name):
        return None
    if config is not None and (config.valid is None or config.given.protocol not in (None, config.protocol)):
        return None  # what is wrong with the port was said there
    if member.takes_part and poll.port == member.port:
        what = "runs N:N"
    elif config is not None and config.protocol is not None:
        what = f"is {config.protocol}"
    else:
        what = "has no protocol" if poll.port in member.plc.ports else "is not in ports"
    near = f"; {suggest(poll.port, usable)}" if usable else ""
    text = f"is {poll.port}, which {what}: only a Modbus master or a free port polls{near}"
    report.error((*entry.path, "port"), text)
    return None


def _check_poll(
    entry: Entry[TransactionIn],
    poll: PollIn,
    place: Placed,
    nodes: Directory,
    answers: Answers,
    report: Report,
) -> None:
    free = place.config.protocol == FREE
    for key in _MODBUS_KEYS if free else _FREE_KEYS:
        if getattr(poll, key) is not None:
            text = f"has no meaning on {poll.port}, whose protocol is {place.config.protocol}"
            report.error((*entry.path, key.rstrip("_")), text, key=True)
    if free:
        check_free_data(entry, poll, place, report)
        return
    _check_values(entry, poll, report)
    if not _check_request(entry, poll, report) or poll.function is None:
        return
    node = next((node for node in nodes.nodes if node.config is place.config), None)
    if SPACES[poll.function].is_bit:
        check_coils(entry, poll, place, poll.quantity, report)
    else:
        check_registers(entry, poll, place, poll.quantity, report)
    if node is not None:
        answers.check(entry, poll, node, place.config.valid.timeout if place.config.valid is not None else 0)


def _check_request(entry: Entry[TransactionIn], poll: TransactionIn, report: Report) -> bool:
    """Whether a request can be made of it; every reason against it is reported."""
    before = len(report.errors)
    for key in ("station", "function", "address"):
        if getattr(poll, key) is None and not entry.lost(key):
            report.error((*entry.path, key), "is missing")
    function, count = poll.function, poll.quantity
    if function is None:
        return False
    limit = STANDARD_LIMITS.of(function)
    if not 1 <= count <= limit:
        at = "count" if poll.count is not None else "values"
        has = f"is {count}" if at == "count" else f"has {count} entries"
        allowed = f"1..{limit}" if limit > 1 else "1"
        report.error((*entry.path, at), f"{has}, allowed {allowed} (function {function})")
    elif poll.address is not None and poll.address + count > 0x10000:
        report.error(
            (*entry.path, "address"),
            f"is {poll.address}, whose {count} items end at {poll.address + count - 1}, beyond 65535",
        )
    if poll.station == BROADCAST and function in READS:
        report.error(
            (*entry.path, "station"),
            f"is 0, a broadcast, which no station answers; function {function} reads",
        )
    whole = all(getattr(poll, key) is not None for key in ("station", "address"))
    return whole and len(report.errors) == before and function in FUNCTIONS


def _check_values(entry: Entry[TransactionIn], poll: TransactionIn, report: Report) -> None:
    """What a write sends."""
    path, function = (*entry.path, "values"), poll.function
    if function is None:
        return
    if poll.values is None:
        has_source = isinstance(poll, PollIn) and poll.from_ is not None
        if function not in READS and not has_source and not entry.lost("values", "from"):
            either = "from or values" if isinstance(poll, PollIn) else "values"
            report.error(entry.path, f"writes nothing; expected {either} (function {function})")
        return
    if function in READS:
        report.error(path, f"has no meaning for function {function}, which reads", key=True)
        return
    if len(poll.values) != poll.quantity:
        report.error(path, f"has {len(poll.values)} entries, count is {poll.count}")
    if SPACES[function].is_bit:
        wrong = next((value for value in poll.values if value not in (0, 1)), None)
        if wrong is not None:
            report.error(path, f"has {wrong}, allowed 0, 1 (coils)")
