"""``bussim new``: a commented scenario of one N:N link, to begin with."""

import re
from importlib.resources import files

import click

from bussim.commands.common.output import print_or_write
from bussim.commands.size.uniform_link import DEFAULT_PROFILE, DEFAULT_SCAN, uniform_link


@click.command()
@click.option("--stations", type=int, default=4, show_default=True, metavar="N", help="The master too.")
@click.option("--mode", type=int, default=0, show_default=True, metavar="D8178", help="Refresh mode.")
@click.option("--scan", metavar="T", default=DEFAULT_SCAN, show_default=True, help="PLC scan time of each.")
@click.option("--profile", metavar="NAME", default=DEFAULT_PROFILE, show_default=True, help="Which PLCs.")
@click.option("--ber", type=float, metavar="P", help="Bit error rate of the line. [default: not known]")
@click.option("-o", "--out", metavar="FILE", help="Where to write it, instead of printing it.")
@click.option("--force", is_flag=True, help="Replace the file if it exists.")
@click.option("--json", "as_json", is_flag=True, help="Print what was written as JSON.")
def command(
    *,
    stations: int,
    mode: int,
    scan: str,
    profile: str,
    ber: float | None,
    out: str | None,
    force: bool,
    as_json: bool,
) -> None:
    """Write a scenario of equal stations on an N:N link, with comments, to be changed by hand.

    For example: bussim new --stations 5 --mode 2 --scan 8ms -o my_line.yaml
    """
    text = new_scenario(stations, mode, scan=scan, profile=profile, ber=ber)
    print_or_write(text, out, (".yaml", ".yml"), force=force, as_json=as_json)


def new_scenario(
    stations: int,
    mode: int,
    *,
    scan: str = DEFAULT_SCAN,
    profile: str = DEFAULT_PROFILE,
    ber: float | None = None,
) -> str:
    """The commented text of the scenario of :func:`uniform_link`, at ports of the profile; raises as it."""
    from bussim.engines.nn.frames import MODES
    from bussim.plc.profiles import MAX_RETRIES, PROFILES
    from bussim.units import format_time

    link = uniform_link(stations, mode, profile=profile, scan=scan, ber=ber)
    master = link.plcs[0]
    port = "COM4" if "COM4" in master.profile.board_ports else "COM3"
    rest = "".join(
        f"  - {{name: {plc.name}, profile: {profile}, scan: {format_time(plc.scan.mean)}, "
        f"nn: {{bus: link, port: {port}, station: {number}}}}}\n"
        for number, plc in enumerate(link.plcs[1:], 1)
    )
    text = (
        files("bussim.commands")
        .joinpath("new.yaml")
        .read_text(encoding="utf-8")
        .format(
            stations=stations,
            slaves=stations - 1,
            mode=mode,
            bits=MODES[mode].bits,
            words=MODES[mode].words,
            scan=format_time(master.scan.mean),
            profile=profile,
            profiles=", ".join(PROFILES),
            retries=master.registers["D8179"],
            most=MAX_RETRIES,
            timeout=f"{10 * master.registers['D8180']} ms",
            rest=rest,
            mark="" if ber else "# ",
            ber=repr(ber) if ber else "1.0e-6",
            port=port,
        )
    )
    return re.sub(r"(?m)^([^#\n]+?) +(?=# )", lambda found: f"{found[1]:<27} ", text)
