"""How long the responses of a run took, for ``bussim size --responses``."""

from pathlib import Path

import click

from bussim.errors import UsageError
from bussim.wording import counted


def longest_responses(folder: Path) -> dict[str, float]:
    """The longest response time of each Modbus master of a run's folder, in ms by master.

    Warns on stderr of masters with late responses, whose times a run does not have. Raises UsageError for
    what is no run, or one without a response.
    """
    from bussim import api

    summary = api.open_run(folder).summary
    found = {}
    for name, entry in (*summary["ports"].items(), *summary["devices"].items()):
        longest = entry.get("response_ms", {}).get("max")
        if longest is not None:
            found[name] = float(longest)
        if entry.get("late_responses"):
            late = (
                f"{name}: {counted(entry['late_responses'], 'response')} of {folder} came after the timeout"
            )
            click.echo(f"warning: {late}, so that their times are not known; run it with more", err=True)
    if not found:
        raise UsageError(f"--responses {folder}: no Modbus master of this run received a response")
    return found
