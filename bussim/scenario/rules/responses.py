"""Which slave responds to a poll, with what, and whether in time: warnings, as all of it happens in a run."""

from collections.abc import Iterable

from bussim.devices.areas import AreaMap
from bussim.devices.contract import SlaveSettings
from bussim.devices.forms import SlaveIn
from bussim.devices.lx.model import LxSettings
from bussim.engines.modbus.adu import BROADCAST, Mode, adu_chars
from bussim.engines.modbus.framing import reply_times
from bussim.engines.modbus.pdu import EXCEPTION_SIZE, READS, Request, response_size
from bussim.engines.modbus.server import SPACES, Space
from bussim.plc.scan import Scan
from bussim.scenario.resolve.members import Member
from bussim.scenario.resolve.nodes import Directory, Node, NodeRole
from bussim.scenario.schema.draft import Entry
from bussim.scenario.schema.polls import TransactionIn
from bussim.scenario.yaml.source_map import Report
from bussim.scenario.yaml.user_code import Code
from bussim.units import format_ms, format_time
from bussim.words.language import say


class Responses:
    """Checks what comes back. Register maps are made once a device, when a poll asks it."""

    def __init__(self, nodes: Directory, polls: Iterable[TransactionIn], code: Code, report: Report) -> None:
        self._nodes = nodes
        self._polls = tuple(polls)
        self._code = code
        self._report = report
        self._slaves: dict[str, tuple[SlaveSettings, AreaMap]] = {}

    def check(self, entry: Entry[TransactionIn], poll: TransactionIn, master: Node, timeout: int) -> None:
        """Check one poll of a master, whose request can be sent."""
        if self._report.errors or not self._nodes.whole:
            return  # warnings beside a mistake are not shown
        slaves = [node for node in self._nodes.on(master.bus) if node.role is NodeRole.SLAVE]
        if poll.station == BROADCAST:
            return
        asked = [node for node in slaves if node.station == poll.station]
        understands = [node for node in asked if node.mode is master.mode]
        path = (*entry.path, "station")
        if not asked and self._may_get(poll.station or 0, slaves):
            return
        if not asked:
            known = sorted({node.station for node in slaves if node.station is not None})
            there = say("rule_it_has", stations=", ".join(map(str, known))) if known else say("rule_has_none")
            self._report.warn(
                path,
                say(
                    "rule_asks_absent", master=master.name, station=poll.station, bus=master.bus, there=there
                ),
            )
        elif not understands:
            modes = {"mode": _name(master.mode), "spoken": _name(asked[0].mode)}
            self._report.warn(
                path,
                say("rule_asks_mode", master=master.name, station=poll.station, asked=asked[0].name, **modes),
            )
        else:
            slave = understands[0]
            settings, registers = self._slave(slave)
            refusal = _refusal(poll, registers)
            if refusal is not None:
                key, why, code = refusal
                text = say("rule_exception", slave=slave.name, why=why, code=code)
                self._report.warn((*entry.path, key), text)
            self._check_time(entry, poll, master, slave, settings, timeout, refused=refusal is not None)

    def _may_get(self, station: int, slaves: list[Node]) -> bool:
        """Whether a poll may write this station number into a slave, or a program that drives its ports."""
        programs = any(node.member is not None and node.member.drives_ports for node in self._nodes.nodes)
        for slave in slaves:
            register = self._slave(slave)[0].station_register
            if register is not None and programs:
                return True
            for poll in self._polls if register is not None else ():
                first, values = poll.address or 0, poll.values or [station] * poll.quantity
                written = dict(enumerate(values, first))  # those of a PLC's memory may be any
                asked = poll.station in (slave.station, BROADCAST) and poll.function not in READS
                if asked and written.get(register or 0) == station:
                    return True
        return False

    def _slave(self, slave: Node) -> tuple[SlaveSettings, AreaMap]:
        """A slave as its model has it, and its map; the port of a PLC is one of the model ``lx``."""
        if slave.name not in self._slaves:
            settings = (
                slave.device.settings((), self._code.find)
                if isinstance(slave.device, SlaveIn)
                else LxSettings(_longest_scan(slave.member))
            )
            self._slaves[slave.name] = settings, settings.register_map()
        return self._slaves[slave.name]

    def _check_time(
        self,
        entry: Entry[TransactionIn],
        poll: TransactionIn,
        master: Node,
        slave: Node,
        settings: SlaveSettings,
        timeout: int,
        *,
        refused: bool,
    ) -> None:
        """Check the timeout against the slave's response, which is an exception where it is ``refused``."""
        if slave.mode is Mode.RTU and slave.timing.format.data_bits != 8:
            return  # it understands nothing anyway
        request = Request(poll.function or 0, poll.address or 0, poll.quantity)
        least, most = _response_time(slave, settings, EXCEPTION_SIZE if refused else response_size(request))
        if least > timeout:
            can = say("rule_takes_least", least=format_ms(least))
        elif most > timeout:
            can = say("rule_takes_most", most=format_ms(most))
        else:
            return
        limit = format_time(timeout)
        label = poll.name or say("rule_function_at", function=poll.function, address=poll.address)
        self._report.warn(
            entry.path,
            say("rule_timeout_poll", master=master.name, limit=limit, slave=slave.name, label=label, can=can),
        )


_NAMES = {
    Space.COILS: "word_coil",
    Space.INPUTS: "word_input",
    Space.INPUT_REGISTERS: "word_input_register",
    Space.HOLDING: "word_register",
}


def _refusal(poll: TransactionIn, registers: AreaMap) -> tuple[str, str, int] | None:
    """The key for which a slave refuses a poll whatever it writes, why, and the exception; None if not."""
    function, address, count = poll.function or 0, poll.address or 0, poll.quantity
    limit, space = registers.limits.of(function), SPACES[function]
    if function not in registers.functions:
        return "function", say("rule_lacks_function", function=function), 1
    if count > limit:
        return "count", say("rule_most_in_function", limit=limit, function=function), 3
    parts = registers.parts(space, address, count)
    if parts is None:
        key = "rule_not_all" if count > 1 else "rule_has_not"
        return "address", say(key, what=_items(space, address, count)), 2
    if function not in READS and not all(part.area.writable for part in parts):
        return "address", say("rule_not_written", what=_items(space, address, count)), 2
    return None


def _items(space: Space, first: int, count: int) -> str:
    key = "rule_items" if count > 1 else "rule_item"
    return say(key, space=say(_NAMES[space]), first=first, last=first + count - 1)


def _name(mode: Mode | None) -> str:
    return f"Modbus {mode.value.upper()}" if mode is not None else say("rule_no_modbus")


def _longest_scan(member: Member | None) -> Scan:
    """The scan at whose END a PLC's port responds."""
    if member is None:
        raise AssertionError("what is no device is the port of a PLC")
    scan = member.plc.scan
    return Scan(member.longest_scan if member.takes_part else scan.mean + scan.jitter)


def _response_time(slave: Node, settings: SlaveSettings, pdu_size: int) -> tuple[int, int]:
    """Least and longest time from a request's end to the end of the response, in ticks."""
    mode, device, scan = slave.mode or Mode.RTU, slave.device, settings.plc_scan()
    delay, jitter = (device.least_delay, device.jitter) if isinstance(device, SlaveIn) else (0, 0)
    waiting = scan.mean + scan.jitter if scan is not None else 0
    port = device.own_port if isinstance(device, SlaveIn) else settings.port
    framing = port.framing(mode, slave.timing)
    _, (least, most) = reply_times(framing, delay=delay, jitter=jitter, end=waiting)
    sent = slave.timing.characters(adu_chars(mode, pdu_size))
    return least + sent, most + sent
