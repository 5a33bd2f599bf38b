"""Random scenarios whose PLCs have programs, inputs and observed devices beside noises and faults."""

from __future__ import annotations

from dataclasses import replace
from random import Random

from bussim.plc.inputs import InputSpec, Pulse, RandomInput, Square, Times
from bussim.plc.profiles import PROFILES
from bussim.plc.program.program import Program
from bussim.plc.sources import Counter
from bussim.scenario import model
from bussim.scenario.loader import loads
from tests.sim import chance
from tests.sim.build import MS, link


def _contact(rng: Random, own: int, spacing: int, *, alone: bool) -> str:
    other = own if alone else rng.choice([0, 1, 2, 3])
    plain = [f"X{rng.randrange(3)}", f"M{rng.randrange(6)}", f"M{1000 + 64 * own + rng.randrange(3)}"]
    rare = [
        f"M{1000 + 64 * other}",
        "M8000",
        "M8002",
        "M8012",
        "M8013",
        "M8022",
        "S0",
        "T0",
        "T200",
        "T192",
        "C0",
    ]
    device = rng.choice(plain if rng.random() < 0.6 else rare)
    name = rng.choice(["LD", "LD", "LDI", "LDP", "LDF"])
    if rng.random() < 0.1:
        return f"LD{rng.choice('=<>')} D{rng.choice([410, 411, spacing * other])} K{rng.randrange(4)}"
    return "LD M8011" if rng.random() < 0.01 else f"{name} {device}"


def _output(rng: Random, own: int, spacing: int, *, alone: bool) -> str:
    word = spacing * own + 1 + rng.randrange(3)
    bit = rng.choice(
        [f"M{rng.randrange(6)}", f"M{1000 + 64 * own + rng.randrange(3)}", f"Y{rng.randrange(3)}"]
    )
    other = spacing * (own if alone else rng.choice([0, 1, 2]))
    choices = [
        f"OUT {bit}",
        f"OUT {bit}",
        f"SET {bit}",
        f"RST {bit}",
        f"PLS M{rng.randrange(6)}",
        f"MOV K{rng.randrange(9)} D{word}",
        f"MOV D{other} D{word}",
        f"MOV T0 D{word}",
        "MOV C0 D410",
        "OUT T0 K3",
        "OUT T200 K7",
        "OUT T192 K2",
        "OUT T246 K80",
        "RST T246",
        "OUT C0 K2",
        "RST C0",
        "INCP D411",
        f"ADD D{word} K1 D410",
        "ALTP M5",
        "DIVP D411 D410 D412",
        "CMP K2 D410 M0",
        "SFTLP X0 M0 K4 K1",
        "SET S0",
        "RST S0",
    ]
    rare = [
        "INC D410",
        f"MOV K7 D{other}",
        "MOV D8010 D410",
        "MOV D8000 D410",
        "MOV K300 D8000",
        "MOV D410 D420Z0",
    ]
    return rng.choice(rare if rng.random() < 0.02 else choices)


def program(rng: Random, own: int, spacing: int, name: str, *, alone: bool) -> Program:
    """A random program that comes to rest more often than not; ``alone``: it reads no other station's block."""
    lines = []

    def contact() -> str:
        return _contact(rng, own, spacing, alone=alone)

    def output() -> str:
        return _output(rng, own, spacing, alone=alone)

    for number in range(rng.randint(1, 5)):
        lines.append(contact())
        kind = rng.random()
        if kind < 0.05:
            lines += [f"CJ P{number}", contact(), output(), f"P{number}"]
        elif kind < 0.1:
            lines += ["MC N0 M4", contact(), output(), "MCR N0"]
        elif kind < 0.13:
            lines[-1:] = ["FOR K2", lines[-1], output(), "NEXT"]
        else:
            lines.append(output())
    return Program.parse("\n".join([*lines, "END"]), name)


def _stimulus(rng: Random) -> InputSpec:
    return rng.choice(
        [
            Square(rng.randint(20, 400) * MS, rng.randint(0, 50) * MS),
            Pulse(rng.randint(1, 60) * MS, rng.randint(0, 300) * MS, rng.choice([None, 90 * MS])),
            RandomInput(80 * MS, 60 * MS),
            Times((30 * MS, 31 * MS, 200 * MS)),
        ]
    )


def scenario(seed: int, seconds: float = 0.7) -> model.Scenario:
    """A random scenario of the link's with programs in most PLCs, the same for the same seed."""
    made, rng = chance.scenario(seed, seconds), Random(seed)
    alone = rng.random() < 0.6
    if rng.random() < 0.6:  # most link scans are ordinary
        noise = [model.Noise("loss", model.Target("link"), model.ReplyLoss(rng.choice([0.0, 0.02, 0.1])))]
        mode, scans = rng.randint(0, 3), {at: {"scan": model.Scan(7 * MS, 2 * MS)} for at in range(4)}
        made = link(
            4, mode, seconds=2 * seconds, profile=PROFILES["pw10"], seed=seed, noise=noise, others=scans
        )
    plcs = []
    for spec in made.plcs:
        own, spacing = spec.registers["D8176"], spec.profile.word_spacing
        changes: dict[str, object] = {}
        if rng.random() < 0.3:
            changes["sources"] = {f"D{spacing * own}": Counter(rng.randint(40, 900) * MS)}
        if rng.random() < 0.8:
            changes["program"] = program(rng, own, spacing, spec.name, alone=alone)
            changes["sources"] = {}
        if rng.random() < 0.7:
            changes["inputs"] = {f"X{point}": _stimulus(rng) for point in range(3) if rng.random() < 0.7}
        if rng.random() < 0.4:
            names = ["M0", "X0", "D410", f"M{1000 + 64 * own}", f"M{1064 - 64 * own % 128}", "D0", "Y0"]
            changes["observed"] = tuple(rng.sample(names[: 4 if alone else 7], 3))
        if rng.random() < 0.3:
            changes["scan"] = model.Scan(10 * MS)  # ENDs of several PLCs at one tick
            changes["phase"] = 0
        plcs.append(replace(spec, **changes))
    return replace(made, plcs=tuple(plcs))


def with_ports(seed: int) -> model.Scenario:
    """A link of three stations, most with a Modbus port on a bus of its own or of two PLCs, some with a program."""
    rng = Random(seed)
    shared = rng.random() < 0.3
    buses = ["bus0"] if shared else ["bus0", "bus1", "bus2"]
    lines = ["schema: 1", "name: ports", "duration: 3 s", f"seed: {seed}"]
    lines.append(f"buses: [{{name: link, nn: true}}, {', '.join(f'{{name: {bus}}}' for bus in buses)}]")
    lines.append("plcs:")
    used = set()
    for station in range(3):
        master = ", slaves: 2, mode: 2, retries: 1, timeout: 50 ms" if not station else ""
        lines += [
            f"  - name: p{station}",
            "    profile: pw10",
            f"    scan: {{mean: 7 ms, jitter: {rng.choice([0, 2])} ms}}",
            f"    nn: {{bus: link, port: COM4, station: {station}{master}}}",
        ]
        bus, kind = buses[station % len(buses)], rng.random()
        if kind < 0.6 and bus not in used:
            used.add(bus)
            lines.append(f"    ports: {{COM3: {{bus: {bus}, protocol: modbus-rtu-master}}}}")
            lines.append("    polls:")
            for slave in (1, 2):
                every = rng.choice([40, 90, 200])
                word = rng.choice([400, 32 * station + 1, 32 * station, 32 * ((station + 1) % 3)])
                reads = rng.random() < 0.8
                what = f"function: {3 if reads else 16}, address: 0, count: 2, {'to' if reads else 'from'}: D{word}"
                lines.append(f"      - {{port: COM3, station: {slave}, {what}, every: {every} ms}}")
        elif kind < 0.85:
            lines += ["    program: |", "      LD X0", f"      OUT M{1000 + 64 * station}", "      END"]
            lines.append("    inputs: {X0: {square: 150 ms}}")
        elif not shared:
            lines.append(f"    ports: {{COM3: {{bus: {bus}, protocol: modbus-rtu-slave, station: 5}}}}")
        if rng.random() < 0.3:
            lines.append(f"    sources: {{D{32 * station + 4}: {{counter: 300 ms}}}}")
    lines.append("devices:")
    for bus in buses:
        lines += [f"  - {{name: {bus}drive, model: stepper, bus: {bus}, station: 1}}"]
        if rng.random() < 0.8:
            lines += [f"  - {{name: {bus}meter, model: v80, bus: {bus}, station: 2}}"]
    if rng.random() < 0.7:
        lines.append("noise:")
        lines.append(f"  - {{bus: link, reply_loss: {rng.choice(['0.001', '0.05'])}}}")
        lines.append(f"  - {{bus: bus0, ber: {rng.choice(['1.0e-5', '1.0e-3'])}}}")
    return loads("\n".join(lines))
