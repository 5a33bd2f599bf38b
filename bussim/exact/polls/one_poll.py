"""One poll of a master: its frames, its slave and when it responds, or why not every time. Times in ticks."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from bussim.engines.modbus.adu import BROADCAST, Mode
from bussim.engines.modbus.framing import Framing, reply_times
from bussim.engines.modbus.master import refusal
from bussim.engines.modbus.pdu import MAX_PDU, READS, WRITES, Request, encode_request, response_size
from bussim.exact.polls.failures import LineErrors
from bussim.exact.polls.master_timing import MasterTiming, Span, exactly
from bussim.exact.polls.poll_list import PollModel
from bussim.exact.polls.slaves import SlaveModel
from bussim.line.characters import LineTiming
from bussim.plc.ports.device_layout import fits, is_bits
from bussim.plc.ports.requests import make_request
from bussim.plc.ports.spec import PollSpec
from bussim.units import format_ms
from bussim.wording import names
from bussim.words.language import say

#: The most registers that one read of all families asks for (V80 manual: 125; coils are fewer words).
_MOST_WORDS = 125


@dataclass(frozen=True, slots=True)
class MasterModel:
    """One master with its polls. ``plc``: a PLC, which works in scans, the first ``first_end`` ticks long.

    ``sized``: timeout and interval are not those that the scenario gives. For ``words`` and ``joined`` see
    :class:`~bussim.exact.polls.poll_list.PollListModel`.
    """

    node: str
    bus: str
    framing: Framing
    timing: LineTiming
    timeout: int
    turnaround: int
    master_timing: MasterTiming
    polls: tuple[PollSpec, ...]
    begun_holds: bool = False
    plc: bool = True
    first_end: int = 0
    errors: LineErrors = field(default_factory=LineErrors)
    sized: bool = False
    words: int | None = None
    joined: tuple[tuple[str, ...], ...] = ()

    @property
    def tail(self) -> int:
        """How long after the timeout an attempt may be decided: see its engine.

        In RTU what had begun by then must be over: its closing silence, and a character in it. Where a
        response that has begun is awaited, so must a whole frame of the longest, with any pauses.
        """
        quiet, character = self.framing.quiet, self.timing.characters(1)
        if self.begun_holds:
            return (self.framing.chars(MAX_PDU + 1) + 1) * (quiet + character)
        return quiet + character if self.framing.mode is Mode.RTU else 0


def poll_model(master: MasterModel, spec: PollSpec, slaves: list[SlaveModel]) -> PollModel | str:
    """A poll and its response, or why it gets none every time."""
    values = spec.values or (0,) * spec.count
    bare = Request(spec.function, spec.address, spec.count)
    error = refusal(spec.station, bare)
    if error is not None:
        return say("poll_cannot_send", why=say(f"port_error_{error:02}"))
    if spec.device is not None and not fits(spec.device, spec.function, spec.count):
        return say("poll_not_in_memory", count=spec.count, device=str(spec.device))
    if spec.function in WRITES and len(values) != spec.count:
        return say("poll_values", values=len(values), count=spec.count)
    request = make_request(spec.function, spec.address, spec.count, values)
    size = master.framing.chars(len(encode_request(request)))
    sent = master.timing.characters(size)
    model = partial(
        PollModel,
        name=spec.name,
        station=spec.station,
        function=spec.function,
        count=spec.count,
        reads=spec.function in READS,
        request=sent,
        every=spec.every,
        at=spec.at,
        times=spec.times,
        retries=spec.retries,
        skip=spec.skip_after_failure,
    )
    if spec.station == BROADCAST:
        over = exactly(sent + master.turnaround)
        return model(device="", response=0, served=over, response_end=over, need=over, after=0, awaited=over)
    asked = [slave for slave in slaves if slave.station == spec.station]
    heard = [slave for slave in asked if slave.understands(master.framing.mode, master.timing)]
    if not heard:
        key = "poll_nobody_format" if asked else "poll_nobody"
        others = names(slave.name for slave in asked)
        return say(key, bus=master.bus, station=spec.station, **({"names": others} if asked else {}))
    if len(heard) > 1:
        return say("poll_both", names=names(slave.name for slave in heard), station=spec.station)
    slave = heard[0]
    if slave.programmed:
        return say("poll_programmed", name=slave.name)
    refused = slave.refuses(request, valued=bool(spec.values) and not is_bits(spec.function))
    if refused:
        return say("poll_refused", name=slave.name, why=refused)
    answer = slave.framing.chars(response_size(request))
    response = slave.timing.characters(answer)
    served, end = _response_times(slave, sent, response)
    begins = response if master.begun_holds else 0
    awaited = Span(end.least - begins, end.most - begins)
    if awaited.most > sent + master.timeout and not master.sized:
        always = awaited.least > sent + master.timeout
        span = _ms_span(Span(end.least - sent, end.most - sent))
        return say("poll_never" if always else "poll_maybe_late", name=slave.name, span=span)
    quiet = exactly(master.framing.closing)
    # Who takes its values early waits for its delay to be over.
    bits = [count * slave.timing.format.bits for count in (size, answer)]
    early = max(served.least, sent + slave.delay) - served.least
    after = early + slave.spread + slave.extra.most + response + quiet.most
    return model(
        device=slave.name,
        response=response,
        served=served,
        response_end=end,
        need=end + quiet,
        after=after,
        awaited=awaited,
        bits=sum(bits),
        hits=master.errors.hits(slave.name, *bits),
        loss=master.errors.loss(slave.name),
        waits=slave.end > 0,
    )


def _response_times(slave: SlaveModel, sent: int, response: int) -> tuple[Span, Span]:
    """When a slave takes its values, and when its response ends, from the request's first edge."""
    served, begins = reply_times(slave.framing, delay=slave.delay, jitter=slave.spread, end=slave.end)
    after = exactly(sent)
    return after + Span(*served), after + Span(*begins) + slave.extra + exactly(response)


def silence_needed(master: MasterModel, slaves: list[SlaveModel]) -> dict[str, int]:
    """The least gap before a request for each slave that would take response and request for one frame."""
    if master.framing.mode is not Mode.RTU or len(master.polls) < 2:
        return {}
    heard = (slave for slave in slaves if slave.understands(master.framing.mode, master.timing))
    needs = {slave.name: slave.framing.quiet - master.framing.quiet for slave in heard}
    return {name: need for name, need in needs.items() if need > 0}


def too_hasty(master: MasterModel, slaves: list[SlaveModel]) -> list[str]:
    """Slaves before whose requests too short a silence lies, in words."""
    gap, quiet = master.master_timing.gap().least, master.framing.quiet
    if master.sized:
        return []
    return [
        say("poll_silence", name=name, needed=format_ms(need + quiet), given=format_ms(gap + quiet))
        for name, need in silence_needed(master, slaves).items()
        if need > gap
    ]


def joined(polls: Sequence[PollSpec]) -> tuple[tuple[PollSpec, ...], tuple[tuple[str, ...], ...]]:
    """Polls with neighbouring reads of one station made one read each, and the names of those that were."""
    groups: list[list[PollSpec]] = []
    for poll in sorted(polls, key=lambda each: each.address):
        for group in groups:
            first, end = group[0], max(each.address + each.count for each in group)
            alike = _alike(first) == _alike(poll) and poll.function in READS and poll.times is None
            if alike and poll.address <= end and poll.address + poll.count - first.address <= _MOST_WORDS:
                group.append(poll)
                break
        else:
            groups.append([poll])
    groups.sort(key=lambda group: min(polls.index(each) for each in group))
    made = tuple(
        replace(
            group[0], count=max(each.address + each.count for each in group) - group[0].address, device=None
        )
        if len(group) > 1
        else group[0]
        for group in groups
    )
    return made, tuple(tuple(each.name for each in group) for group in groups if len(group) > 1)


def _alike(poll: PollSpec) -> tuple[object, ...]:
    return poll.station, poll.function, poll.every, poll.at, poll.times, poll.skip_after_failure


def _ms_span(span: Span) -> str:
    least, most = format_ms(span.least), format_ms(span.most)
    return least if span.fixed else say("poll_span", least=least, most=most)
