"""``bussim inject``: a fault in a scenario that is being served."""

import click

from bussim.commands.common.output import print_json
from bussim.errors import UsageError

_OPTIONS = (
    ("count", "N", "So many replies or frames (drop_reply, flip_bits, lose_char, insert_char, pause)."),
    ("for", "T", "So long; else to the end."),
    ("extra", "T", "slow: so much later."),
    ("by", "T", "late_release, pause: so long."),
    ("format", "F", "wrong_format: such as 7O1."),
    ("baud", "N", "wrong_format: another rate."),
    ("ppm", "N", "clock_ppm: parts per million."),
    ("bits", "LIST", "flip_bits: bits of a frame from 0, such as [31,32]."),
    ("frame", "KIND", "flip_bits: only request, response, data, poll or parameters."),
    ("direction", "SIDE", "flip_bits, lose_char, insert_char: what it sends (tx) or hears (rx)."),
    ("index", "N", "lose_char, insert_char, pause: which character, from 0."),
    ("value", "N", "insert_char: which value."),
    ("code", "N", "board_error: 10…19, 40…47 or 49."),
)


def _options(function: click.Command) -> click.Command:
    for name, metavar, text in reversed(_OPTIONS):
        click.option(f"--{name}", f"value_{name}", metavar=metavar, help=text)(function)
    return function


@_options
@click.command()
@click.argument("node", metavar="[NODE]", required=False)
@click.argument("kind", metavar="[FAULT]", required=False)
@click.option("--process", metavar="N", type=int, help="Of several that serve, the process of this number.")
@click.option("--json", "as_json", is_flag=True, help="Print the reply as JSON.")
def command(
    node: str | None, kind: str | None, *, process: int | None, as_json: bool, **values: str | None
) -> None:
    """Let a fault begin now in a scenario that `bussim serve` is serving.

    NODE is a PLC, a port such as press1.COM3, or a device; FAULT is drop_reply, slow, power_off, stop,
    jabber, late_release, wrong_format, clock_ppm, flip_bits, lose_char, insert_char, pause, cable_cut
    (behind the node) or board_error, as in a scenario. Without them: what is being served.
    """
    from bussim.serve.control import running

    found = running()
    if node is None:
        _list(found, as_json=as_json)
        return
    if kind is None:
        raise UsageError("name a fault, too, such as: bussim inject press1.COM3 drop_reply --count 3")
    chosen = [one for one in found if process in (None, one.process)]
    if not chosen:
        raise UsageError(
            "nothing is being served" if process is None else f"process {process} serves nothing"
        )
    if len(chosen) > 1:
        those = ", ".join(f"{one.process} ({one.scenario})" for one in chosen)
        raise UsageError(f"several processes serve: choose with --process one of {those}")
    given = {name.removeprefix("value_"): text for name, text in values.items() if text is not None}
    try:
        reply = chosen[0].ask(do="inject", node=node, kind=kind, values=given)
    except OSError as error:
        raise UsageError(f"process {chosen[0].process} gives no reply: {error.strerror or error}") from error
    if as_json:
        print_json(reply)
        return
    click.echo(reply["text"])
    for odd in reply["odd"]:
        click.echo(f"note: {odd}", err=True)


def _list(found: list, *, as_json: bool) -> None:  # type: ignore[type-arg] # the class is imported lazily
    replies = [{"process": one.process, **one.ask(do="list")} for one in found]
    if as_json:
        print_json(replies)
        return
    if not replies:
        click.echo("nothing is being served")
    for reply in replies:
        click.echo(f"process {reply['process']}: {reply['scenario']}, for {reply['now_s']:.0f} s")
        for served in reply["nodes"]:
            click.echo(f"  {served}")
