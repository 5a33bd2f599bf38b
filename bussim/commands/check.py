"""``bussim check``: every mistake and every warning of a scenario, without running it."""

import sys
from dataclasses import replace

import click

from bussim.commands.common.output import print_json, print_or_write, to_json
from bussim.commands.common.scenario_options import code_option, lang_option, unsimulated_option, values_of
from bussim.devices.contract import MasterSettings
from bussim.errors import Problem, UsageError
from bussim.plc.program.program import Program
from bussim.scenario.loader import Examined, examine
from bussim.scenario.model import Scenario
from bussim.units import format_time
from bussim.words.language import say, shown


@click.command()
@click.argument("scenarios", metavar="SCENARIO…", nargs=-1)
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option("--schema", is_flag=True, help="Print the JSON Schema of scenario files, for editors.")
@click.option("-o", "--out", metavar="FILE", help="Where to write the JSON Schema, instead of printing it.")
@click.option("--force", is_flag=True, help="Replace the file if it exists.")
@unsimulated_option
@code_option
@lang_option
def command(
    scenarios: tuple[str, ...],
    *,
    as_json: bool,
    schema: bool,
    out: str | None,
    force: bool,
    allow_code: bool,
    allow_unsimulated: bool,
) -> None:
    """Name every mistake of scenarios with its line and column.

    SCENARIO is a file, the name of a built-in scenario, or - for standard input. The exit code is 2 if
    there is a mistake in one of them; warnings leave it at 0. With --schema there is no SCENARIO: an editor
    then names most mistakes while they are written.
    """
    if schema:
        if scenarios:
            raise UsageError(f"--schema and {scenarios[0]} exclude each other: it is of all scenarios")
        from bussim.scenario.schema.json_schema import json_schema

        text = to_json(json_schema(), indent=None)  # is JSON whether that is asked for or not
        print_or_write(text, out, (), force=force, as_json=as_json and out is not None)
        return
    if out is not None or force:
        raise UsageError(f"{'--force' if out is None else '--out'} goes with --schema")
    if not scenarios:
        raise UsageError("name a SCENARIO, - for standard input, or --schema")
    found = []
    values = values_of((), allow_unsimulated=allow_unsimulated)
    for name in scenarios:
        called, source = ("<stdin>", sys.stdin.buffer) if name == "-" else (name, None)
        found.append((called, examine(called, values, allow_code=allow_code, source=source)))
    ok = all(examined.scenario is not None for _, examined in found)
    if as_json:
        files = [{"file": name, **_as_json(examined)} for name, examined in found]
        print_json({"schema": 2, "ok": ok, "files": files}, indent=1)
    for name, examined in () if as_json else found:
        for warning in examined.warnings:
            said = say("check_warning", message=warning.message)
            click.echo(str(shown(replace(warning, message=said))))
        for error in examined.errors:
            click.echo(str(shown(error)), err=True)
        if examined.scenario is not None:
            _show(name, examined.scenario)
    if not ok:
        raise click.exceptions.Exit(2)


def _show(name: str, scenario: Scenario) -> None:
    click.echo(shown(say("check_ok", name=name, what=describe(scenario))))
    for plc in scenario.plcs:
        if plc.program is not None:
            click.echo("  " + shown(say("check_program", plc=plc.name, program=_program(plc.program))))


def describe(scenario: Scenario) -> str:
    """What a scenario has in it, in one line."""
    links = len(scenario.links)
    counts = {
        "plcs": len(scenario.plcs),
        "links": links,
        "other_buses" if links else "buses": len(scenario.buses) - links,
        "devices": len(scenario.devices),
        "polls": _polls(scenario),
        "programs": sum(plc.program is not None for plc in scenario.plcs),
        "latencies": len(scenario.latency),
        "noise": len(scenario.noise),
        "faults": len(scenario.faults),
    }
    parts = [_count(number, what) for what, number in counts.items() if number]
    run = say("check_run", duration=format_time(scenario.duration), seed=scenario.seed)
    return say("check_has", name=scenario.name, parts=[*parts, run])


def _program(program: Program) -> str:
    number = _count(len(program.instructions), "instructions")
    kind = say("check_kind", kind=program.kind) if program.kind else ""
    return say("check_size", steps=_count(program.steps, "steps"), number=number, kind=kind)


def _polls(scenario: Scenario) -> int:
    hmis = [device.settings for device in scenario.devices if isinstance(device.settings, MasterSettings)]
    return sum(len(plc.polls) for plc in scenario.plcs) + sum(len(hmi.polls) for hmi in hmis)


def _count(number: int, what: str) -> str:
    return say(f"check_one_{what}" if number == 1 else f"check_{what}", number=number)


def _as_json(examined: Examined) -> dict[str, object]:
    found = examined.scenario
    return {
        "ok": found is not None,
        "scenario": found.name if found is not None else None,
        "programs": {
            plc.name: {
                "steps": plc.program.steps,
                "instructions": len(plc.program.instructions),
                **({"read_as": plc.program.kind} if plc.program.kind else {}),
            }
            for plc in (found.plcs if found is not None else ())
            if plc.program is not None
        },
        "errors": [_problem(problem) for problem in examined.errors],
        "warnings": [_problem(problem) for problem in examined.warnings],
    }


def _problem(problem: Problem) -> dict[str, object]:
    keys = {name: getattr(problem, name) for name in ("file", "line", "column", "path")}
    return {**keys, "text": problem.message}
