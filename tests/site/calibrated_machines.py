"""Machines whose profile is unknown to a technician, simulated in the experiments of a calibration."""

from random import Random
from typing import Any

from bussim.api import run
from bussim.scenario.loader import from_data
from bussim.site.writing import readout_data
from tests.site.machines import PLACES


def machine(combination: dict[str, str], seed: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """The calibration of a machine with some discrete fields and random times, and its true times in ms."""
    random = Random(f"{sorted(combination.items())} {seed}")
    slaves, mode = random.randint(3, 6), random.randint(1, 2)
    times = {
        "gap": random.uniform(0.2, 1.5),
        "turnaround": random.uniform(0.2, 3),
        "overhead": random.uniform(0.5, 8),
    }
    profile = {
        "base": "pw10", **combination, "master_gap": f"{times['gap']:.3f} ms", "scan_overhead": f"{times['overhead']:.3f} ms",
        "turnaround": {"mean": f"{times['turnaround']:.3f} ms", "jitter": "0.1 ms"},
    }  # fmt: skip
    scans = [random.randint(5, 14) for _ in range(slaves + 1)]
    cut = random.randint(2, slaves)
    ber = random.choice((0, 3e-6, 3e-5))

    def experiment(
        name: str, retries: int, timeout: int, used: int, *, slow: int = 0, off: bool = False
    ) -> dict[str, Any]:
        plcs = []
        for number, place in enumerate(PLACES[: slaves + 1]):
            link: dict[str, Any] = {"bus": "link", "port": "COM4", "station": number}
            if number == 0:
                link |= {"slaves": used, "mode": mode, "retries": retries, "timeout": f"{timeout} ms"}
            scan = slow if slow and number == 1 else scans[number]
            plcs.append({"name": place, "profile": profile, "scan": f"{scan} ms", "nn": link})
        faults = [
            {"at": f"{at} s", "for": f"{lasts} s", "power_off": PLACES[cut]}
            for at, lasts in ((10, 5), (25, 5), (40, 60))
        ]
        data = {
            "schema": 1, "name": name, "duration": "100 s" if off else "8 s", "seed": seed + 1, "buses": [{"name": "link", "nn": True}],
            "plcs": plcs, "faults": faults if off else [], "noise": [{"bus": "link", "ber": ber}] if ber else [],
        }  # fmt: skip
        result = run(from_data(data))
        assert result.totals is not None
        read = readout_data(from_data(data), result.totals)["stations"][0]["after"]
        unit = {"100 us": 0.1, "1 ms": 1.0, "10 ms": 10.0}[combination.get("link_scan_unit", "1 ms")]
        durations = result.link_scans["duration_ms"][result.link_scans["start_s"] > (88 if off else 1)]
        looks = [int(random.choice(list(durations)) / unit + 0.5) for _ in range(10)]
        found = {
            "name": name,
            "retries": retries,
            "timeout": f"{timeout} ms",
            "slaves": used,
            "D8201": looks,
            "D8202": read["D8202"],
        }
        if slow:
            found["slow_plc"] = {"number": 1, "scan": f"{slow} ms"}
        if off:
            found |= {
                "cut": {"number": cut, "times": 3, "last_for": "60 s"},
                f"D{8203 + cut}": read[f"D{8203 + cut}"],
            }
        return found

    experiments = [
        experiment("all", 3, 100, slaves), experiment("one", 3, 100, 1), experiment("one_slow", 3, 150, 1, slow=80),
        experiment("off_3_100", 3, 100, slaves, off=True), experiment("off_10_50", 10, 50, slaves, off=True),
    ]  # fmt: skip
    data = {
        "schema": 1,
        "kind": "calibration",
        "profile": "pw10",
        "settings": {"slaves": slaves, "mode": mode},
        "experiments": experiments,
    }
    return data, times
