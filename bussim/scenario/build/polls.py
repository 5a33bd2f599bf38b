"""From entries of ``polls`` without mistakes to frozen values, and to plain data with every default."""

from collections.abc import Iterator, Sequence

from bussim.forms.form import as_written
from bussim.plc.ports.spec import FreeSpec, PollSpec
from bussim.scenario.build.names import unique_names
from bussim.scenario.resolve.members import Member
from bussim.scenario.resolve.port_configuration import FREE
from bussim.scenario.schema.polls import PollIn, TransactionIn


def polls_of(member: Member, polls: Sequence[TransactionIn]) -> tuple[PollSpec | FreeSpec, ...]:
    """The polls of a PLC."""
    free = {config.name for config in member.ports if config.protocol == FREE}
    return tuple(
        _free(name, poll) if poll.port in free else _transaction(name, poll.port, poll)
        for name, poll in _named(polls)
        if isinstance(poll, PollIn)
    )


def master_polls(polls: Sequence[TransactionIn]) -> tuple[PollSpec, ...]:
    """The polls of a device that is a master."""
    return tuple(_transaction(name, "", poll) for name, poll in _named(polls))


def _named(polls: Sequence[TransactionIn]) -> Iterator[tuple[str, TransactionIn]]:
    """Polls with their names: those given, for the rest what they ask."""
    return zip(unique_names((poll.name for poll in polls), map(_label, polls)), polls, strict=True)


def _label(poll: TransactionIn) -> str:
    port = [poll.port] if isinstance(poll, PollIn) else []
    if poll.function is None:
        return " ".join([*port, "free"])
    return " ".join([*port, f"station {poll.station}", f"{poll.function:02X}", f"@{poll.address}"])


def _transaction(name: str, port: str, poll: TransactionIn) -> PollSpec:
    return PollSpec(
        name=name,
        port=port,
        count=poll.quantity,
        device=(poll.to or poll.from_) if isinstance(poll, PollIn) else None,
        values=tuple(value & 0xFFFF for value in poll.values or ()),
        **poll.given("name", "port", "count", "to", "from_", "values"),
    )


def _free(name: str, poll: PollIn) -> FreeSpec:
    data = poll.data or poll.text or b""
    given = poll.given("name", "data", "text", "to")
    return FreeSpec(name=name, data=data, device=poll.to, **{"send_count": len(data), **given})


def written_poll(poll: TransactionIn) -> dict[str, object]:
    """A poll in the file's own form. A name that it was not given stays open: what it asks names it."""
    if poll.function is not None:
        return as_written(poll, count=poll.quantity, retries=0, skip_after_failure=1)
    data = poll.data or poll.text if isinstance(poll, PollIn) else None
    return as_written(poll, **({} if data is None else {"send_count": len(data)}))
