"""Checks across values: whether the parts of a scenario fit each other."""

from bussim.scenario.resolve.scenario import Resolved
from bussim.scenario.rules.buses import check_buses
from bussim.scenario.rules.disturbances import check_faults, check_noise
from bussim.scenario.rules.links import check_links
from bussim.scenario.rules.names import check_names
from bussim.scenario.rules.observed import check_latencies, check_observed
from bussim.scenario.rules.plausible import check_plausible
from bussim.scenario.rules.plcs import check_plcs
from bussim.scenario.rules.ports import check_port_use, check_ports
from bussim.scenario.rules.programs import check_programs
from bussim.scenario.yaml.source_map import Report


def check_rules(resolved: Resolved, report: Report) -> None:
    """Report every mistake and oddity, each rule once."""
    check_names(resolved, report)
    check_plcs(resolved, report)
    check_ports(resolved, report)
    if resolved.draft.devices:
        from bussim.scenario.rules.devices import check_devices  # what only a scenario with devices pays

        check_devices(resolved, report)
    check_links(resolved, report)
    check_buses(resolved, report)
    if resolved.draft.polls:
        from bussim.scenario.rules.polls import check_polls  # and one with polls

        check_polls(resolved, report)
    check_port_use(resolved, report)
    check_programs(resolved, report)
    check_observed(resolved, report)
    check_latencies(resolved, report)
    check_noise(resolved, report)
    check_faults(resolved, report)
    check_plausible(report)
