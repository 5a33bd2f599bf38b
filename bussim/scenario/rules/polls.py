"""What is wrong or odd about polls: whether they can be sent, where their data lie, which slave responds."""

from collections.abc import Sequence
from dataclasses import dataclass

from bussim.devices.forms import MasterIn
from bussim.engines.modbus.adu import BROADCAST
from bussim.engines.modbus.pdu import FUNCTIONS, READS, STANDARD_LIMITS
from bussim.engines.modbus.server import SPACES
from bussim.plc.memory import BIT_RANGES, FIRST_SPECIAL, WORD_RANGES, Device
from bussim.plc.ports import cpavl
from bussim.scenario.resolve.members import Member
from bussim.scenario.resolve.nodes import Directory
from bussim.scenario.resolve.port_configuration import FREE, PortConfiguration
from bussim.scenario.resolve.scenario import Resolved
from bussim.scenario.rules.links import blocks_of
from bussim.scenario.rules.responses import Responses
from bussim.scenario.schema.draft import Entry, readable, values_of
from bussim.scenario.schema.polls import PollIn, TransactionIn
from bussim.scenario.yaml.source_map import Path, Report
from bussim.words.language import say
from bussim.words.values import suggest

#: Keys of a Modbus poll only, and of a free-protocol one only.
_MODBUS_KEYS = ("station", "function", "address", "from_", "values", "retries", "skip_after_failure")
_FREE_KEYS = ("send", "send_count", "data", "text")
#: Devices that coils are read into and written from.
_COIL_LETTERS = "DMSY"


@dataclass(frozen=True, slots=True)
class PolledPort:
    """The PLC and the port that a poll belongs to, among all PLCs."""

    member: Member
    config: PortConfiguration
    members: Sequence[Member]


def check_polls(resolved: Resolved, report: Report) -> None:
    """Check the polls of every PLC and of every device that is a master."""
    every = [poll for polls in resolved.draft.polls.values() for poll in values_of(polls)]
    responses = Responses(resolved.nodes, every, resolved.code, report)
    for member in resolved.members:
        for entry, poll in readable(resolved.draft.polls.get(member.path, ())):
            if isinstance(poll, PollIn):
                config = _config(entry, poll, member, resolved.nodes, report)
                if config is not None:
                    port = PolledPort(member, config, resolved.members)
                    _check_poll(entry, poll, port, resolved.nodes, responses, report)
    for node in resolved.nodes.nodes:
        if not isinstance(node.device, MasterIn):
            continue
        for entry, poll in readable(resolved.draft.polls.get(node.path, ())):
            _check_values(entry, poll, report)
            if _check_request(entry, poll, report):
                responses.check(entry, poll, node, node.device.timeout)


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
        what = say("rule_runs_link")
    elif config is not None and config.protocol is not None:
        what = say("rule_is_protocol", protocol=config.protocol)
    else:
        what = say("rule_no_protocol") if poll.port in member.plc.ports else say("rule_not_in_ports")
    near = say("form_hint", hint=suggest(poll.port, usable)) if usable else ""
    text = say("rule_cannot_poll", port=poll.port, what=what, near=near)
    report.error((*entry.path, "port"), text)
    return None


def _check_poll(
    entry: Entry[TransactionIn],
    poll: PollIn,
    port: PolledPort,
    nodes: Directory,
    responses: Responses,
    report: Report,
) -> None:
    free = port.config.protocol == FREE
    for key in _MODBUS_KEYS if free else _FREE_KEYS:
        if getattr(poll, key) is not None:
            text = say("rule_key_on_port", port=poll.port, protocol=port.config.protocol)
            report.error((*entry.path, key.rstrip("_")), text, key=True)
    if free:
        _check_free_data(entry, poll, port, report)
        return
    _check_values(entry, poll, report)
    if not _check_request(entry, poll, report) or poll.function is None:
        return
    node = next((node for node in nodes.nodes if node.config is port.config), None)
    _check_operand(entry, poll, port, report)
    if node is not None:
        responses.check(entry, poll, node, port.config.valid.timeout if port.config.valid is not None else 0)


def _check_request(entry: Entry[TransactionIn], poll: TransactionIn, report: Report) -> bool:
    """Whether a request can be made of it; every reason against it is reported."""
    before = len(report.errors)
    for key in ("station", "function", "address"):
        if getattr(poll, key) is None and not entry.lost(key):
            report.error((*entry.path, key), say("form_missing"))
    function, count = poll.function, poll.quantity
    if function is None:
        return False
    limit = STANDARD_LIMITS.of(function)
    if not 1 <= count <= limit:
        at = "count" if poll.count is not None else "values"
        has = say("rule_is", found=count) if at == "count" else say("rule_entries", count=count)
        allowed = f"1..{limit}" if limit > 1 else "1"
        report.error(
            (*entry.path, at), say("rule_count_allowed", has=has, allowed=allowed, function=function)
        )
    elif poll.address is not None and poll.address + count > 0x10000:
        report.error(
            (*entry.path, "address"),
            say("rule_beyond_65535", address=poll.address, count=count, last=poll.address + count - 1),
        )
    if poll.station == BROADCAST and function in READS:
        report.error((*entry.path, "station"), say("rule_broadcast_reads", function=function))
    whole = all(getattr(poll, key) is not None for key in ("station", "address"))
    return whole and len(report.errors) == before and function in FUNCTIONS


def _check_values(entry: Entry[TransactionIn], poll: TransactionIn, report: Report) -> None:
    path, function = (*entry.path, "values"), poll.function
    if function is None:
        return
    if poll.values is None:
        has_source = isinstance(poll, PollIn) and poll.from_ is not None
        if function not in READS and not has_source and not entry.lost("values", "from"):
            either = say("rule_from_or_values") if isinstance(poll, PollIn) else "values"
            report.error(entry.path, say("rule_writes_nothing", either=either, function=function))
        return
    if function in READS:
        report.error(path, say("rule_function_reads", function=function), key=True)
        return
    if len(poll.values) != poll.quantity:
        report.error(path, say("rule_values_count", values=len(poll.values), count=poll.count))
    if SPACES[function].is_bit:
        wrong = next((value for value in poll.values if value not in (0, 1)), None)
        if wrong is not None:
            report.error(path, say("rule_coil_value", wrong=wrong))


# -- where the data lie in a PLC's memory ------------------------------------------------------------------


def _check_operand(entry: Entry[TransactionIn], poll: PollIn, port: PolledPort, report: Report) -> None:
    """Registers lie in D, coils in bits or packed in D."""
    key, device = _operand(entry, poll, report)
    if device is None or poll.function is None:
        return
    path, count, bits = (*entry.path, key), poll.quantity, SPACES[poll.function].is_bit
    if bits and device.letter not in _COIL_LETTERS:
        allowed = say("rule_coil_devices", letters=", ".join(_COIL_LETTERS), function=poll.function)
        report.error(path, say("rule_is_comma", device=device, why=allowed))
    elif not bits and device.letter != "D":
        report.error(path, say("rule_registers_d", device=device, function=poll.function))
    else:
        size = (count + 15) // 16 if bits and device.letter == "D" else count
        what = "word_coil" if bits else "word_data_register"
        _check_span(path, device, size, (count, what), port, report, writes=key == "to" or bool(poll.values))


def _operand(entry: Entry[TransactionIn], poll: PollIn, report: Report) -> tuple[str, Device | None]:
    """The key and the device of the instruction's operand n."""
    reads = poll.function in READS
    wrong = "from" if reads else "to"
    if getattr(poll, "from_" if reads else "to") is not None:
        verb = say("rule_reads") if reads else say("rule_writes")
        report.error(
            (*entry.path, wrong), say("rule_function_which", function=poll.function, does=verb), key=True
        )
    if reads:
        if poll.to is None and not entry.lost("to"):
            report.error((*entry.path, "to"), say("form_missing"))
        return "to", poll.to
    return "from", poll.from_


def _some(number: tuple[int, str]) -> str:
    count, what = number
    return say("rule_one" if count == 1 else "rule_several", count=count, what=say(what))


def _check_span(
    path: Path,
    first: Device,
    size: int,
    number: tuple[int, str],
    port: PolledPort,
    report: Report,
    *,
    writes: bool,
) -> None:
    """Where the data end, and what they overwrite if the poll writes there."""
    ranges = WORD_RANGES["D"] if first.letter == "D" else BIT_RANGES[first.letter]
    end = first.address + size - 1
    last = next(last for low, last in ranges if low <= first.address <= last)
    if end > last:
        report.error(
            path, say("rule_end_beyond", first=first, what=_some(number), last=Device(first.letter, last))
        )
        return
    if not writes:
        return
    until, wrong = Device(first.letter, end), []
    if first.letter in "DM" and end >= FIRST_SPECIAL:
        wrong.append(("rule_writes_special", first.letter))
    if any(_overlaps(first, end, bit, bits, word, words) for bit, bits, word, words in _blocks(port)):
        wrong.append(("rule_writes_block", ""))
    wrong += [
        ("rule_writes_cpavl", config.name)
        for config in port.member.ports
        if _overlaps(first, end, config.bits.address, cpavl.BITS, config.words.address, cpavl.WORDS)
    ]
    for key, where in wrong:
        span = say("rule_to", first=first, until=until) if size > 1 else f"{first}"
        text = say(key, name=port.member.name, what=_some(number), span=span, where=where)
        report.warn(path, text)


def _blocks(port: PolledPort) -> list[tuple[int, int, int, int]]:
    blocks = blocks_of(port.member, port.members)
    return [(b.bit, b.bits, b.word, b.words) for at, b in blocks.items() if at != port.member.station]


def _overlaps(first: Device, end: int, bit: int, bits: int, word: int, words: int) -> bool:
    if first.letter == "D":
        return first.address < word + words and word <= end
    return first.letter == "M" and first.address < bit + bits and bit <= end


# -- free protocol -------------------------------------------------------------------------------------


def _check_free_data(entry: Entry[TransactionIn], poll: PollIn, port: PolledPort, report: Report) -> None:
    """Bytes lie in D, one or two a word."""
    if poll.data is not None and poll.text is not None:
        report.error((*entry.path, "text"), say("rule_excludes_data"))
    data = poll.data or poll.text or b""
    send_count = poll.send_count if poll.send_count is not None else len(data)
    count = poll.count or 0
    if poll.count is not None and poll.count > 256:
        report.error((*entry.path, "count"), say("rule_count_bytes", count=poll.count))
        return
    if send_count < len(data):
        report.error(
            (*entry.path, "send_count"), say("rule_fewer_bytes", send_count=send_count, data=len(data))
        )
    if not send_count and not count and not entry.lost("send_count", "count", "data", "text"):
        report.error(entry.path, say("rule_neither"))
    settings = port.config.valid
    eight_bit = settings is not None and settings.eight_bit
    for key, device, size in (("send", poll.send, send_count), ("to", poll.to, count)):
        if device is None:
            if size and not entry.lost(key):
                holds = say("rule_received_into") if key == "to" else say("rule_sent_from")
                report.error((*entry.path, key), say("rule_missing_first", holds=holds))
        elif device.letter != "D":
            report.error((*entry.path, key), say("rule_bytes_in_d", device=device))
        elif size:
            words = size if eight_bit else (size + 1) // 2
            path, what = (*entry.path, key), (size, "word_byte")
            writes = key == "to" or bool(data)
            _check_span(path, device, words, what, port, report, writes=writes)
    timing = settings.timing if settings is not None else None
    if timing is not None and timing.format.data_bits == 7 and any(byte > 127 for byte in data):
        key = "data" if poll.data is not None else "text"
        report.warn((*entry.path, key), say("rule_7_bits", config=port.config.node, format=timing.format))
