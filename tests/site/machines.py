"""Random machines with one thing wrong, simulated, and what a technician would note at them."""

from random import Random
from typing import Any

from bussim.api import run
from bussim.scenario.loader import from_data
from bussim.site.writing import readout_data

CAUSES = (
    "station_off", "cable_cut", "wrong_format", "number_twice", "two_masters", "slow_reply", "noise_receiver",
    "noise_receivers", "noise_wire", "noise_bursts", "noise_sender", "replies_lost", "was_away", "master_away", "healthy",
)  # fmt: skip
PLACES = ("press", "feeder", "lift", "saw", "oven", "washer", "packer", "stacker")


def _log(random: Random, low: float, high: float) -> float:
    return low * (high / low) ** random.random()


def machine(cause: str, seed: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """A scenario as plain data, and the truth: its cause, and the station that it is at."""
    random = Random(f"{cause} {seed}")
    slaves = random.randint(2, 7)
    # What has no fast path is simulated more briefly.
    costly = cause in ("wrong_format", "number_twice", "two_masters", "slow_reply")
    seconds = random.choice((60, 90) if costly else (120, 180, 300))
    retries, timeout = random.choice((0, 1, 3, 3)), random.choice((50, 80, 100))
    places = list(PLACES[: slaves + 1])
    numbers = list(range(slaves + 1))
    bus: dict[str, Any] = {
        "name": "link",
        "nn": True,
        "contention": random.choice(("zero_wins", "undefined")),
    }
    faults: list[dict[str, Any]] = []
    noise: list[dict[str, Any]] = []
    profiles: dict[int, Any] = {}
    late: dict[str, str] = {}
    if random.random() < 0.5:
        late = {place: f"{random.randint(1, 80) / 10} s" for place in places[1:] if random.random() < 0.7}
    at = random.randint(0, slaves)
    k = random.randint(1, slaves)
    truth: dict[str, Any] = {"cause": cause, "numbers_read": random.random() < 0.5}
    begin = f"{random.randint(20, seconds - 15)} s"
    scans = [random.randint(4, 15) for _ in places]
    if cause == "station_off":
        faults = [{"at": begin, random.choice(("power_off", "stop")): places[k]}]
    elif cause == "cable_cut":
        k = random.randint(1, slaves)
        faults = [{"at": begin, "cable_cut": {"bus": "link", "after": places[k - 1]}}]
    elif cause == "wrong_format":
        wrong = random.choice(
            (
                {"format": "8N1"},
                {"format": "7O1"},
                {"baud": 19200, "format": "7E1"},
                {"baud": 9600, "format": "7E1"},
            )
        )
        faults = [{"wrong_format": {"station": places[k], **wrong}}]
    elif cause == "number_twice":
        missing = random.choice([number for number in range(1, slaves + 1) if number != k])
        numbers[missing] = k
        truth["numbers_read"] = False
    elif cause == "two_masters":
        numbers[k] = 0
        truth["numbers_read"] = False
    elif cause == "slow_reply":
        timeout = 50
        if random.random() < 0.5:
            profiles[k] = {"base": "pw10", "reply": "end"}
            scans[k] = random.randint(45, 70)
        else:
            faults = [
                {
                    "slow": {
                        "station": places[k],
                        "extra": f"{50 - 0.26 * (14, 30, 54)[1] + random.randint(-2, 25)} ms",
                    }
                }
            ]
    elif cause == "noise_receiver":
        k = at
        noise = [{"bus": "link", "station": places[k], "direction": "rx", "ber": _log(random, 2e-5, 6e-4)}]
    elif cause == "noise_receivers":
        noise = [
            {"bus": "link", "station": place, "direction": "rx", "ber": _log(random, 2e-5, 6e-4)}
            for place in places
        ]
    elif cause == "noise_wire":
        noise = [{"bus": "link", "ber": _log(random, 2e-5, 6e-4)}]
    elif cause == "noise_bursts":
        noise = [
            {
                "bus": "link",
                "burst": {
                    "good": f"{random.randint(2, 20)} s",
                    "bad": f"{random.randint(50, 600)} ms",
                    "ber_good": 0,
                    "ber_bad": _log(random, 3e-3, 5e-2),
                },
            }
        ]
    elif cause == "noise_sender":
        noise = [{"bus": "link", "station": places[k], "direction": "tx", "ber": _log(random, 2e-5, 1e-3)}]
    elif cause == "replies_lost":
        noise = [{"bus": "link", "station": places[k], "reply_loss": _log(random, 0.005, 0.2)}]
    elif cause == "was_away":
        away = random.randint(2, 20)
        faults = [
            {
                "at": f"{random.randint(20, seconds - 25)} s",
                "for": f"{away} s",
                random.choice(("power_off", "stop")): places[k],
            }
        ]
    elif cause == "master_away":
        faults = [{"at": begin, random.choice(("power_off", "stop")): places[0]}]
    mode = random.randint(0, 2)
    plcs = []
    for place, number, scan in zip(places, numbers, scans, strict=True):
        link: dict[str, Any] = {"bus": "link", "port": "COM4", "station": number}
        if number == 0:
            link |= {"slaves": slaves, "mode": mode, "retries": retries, "timeout": f"{timeout} ms"}
        index = places.index(place)
        plcs.append({"name": place, "profile": profiles.get(index, "pw10"), "scan": f"{scan} ms", "nn": link})
    data = {
        "schema": 1,
        "name": cause,
        "duration": f"{seconds} s",
        "seed": seed + 1,
        "buses": [bus],
        "plcs": plcs,
        "noise": noise,
        "faults": faults,
    }
    if late:
        data["faults"] = [*faults, {"power_on": late}]
    truth |= {
        "station": k,
        "slaves": slaves,
        "retries": retries,
        "timeout": timeout,
        "seconds": seconds,
        "noise": noise,
        "faults": faults,
        "late": late,
    }
    return data, truth


def noted(data: dict[str, Any], truth: dict[str, Any]) -> dict[str, Any]:
    """The readout of a machine."""
    scenario = from_data(data)
    totals = run(scenario, rows=False).totals
    assert totals is not None
    readout = readout_data(scenario, totals, as_seen=not truth["numbers_read"])
    readout["profile"] = "pw10"
    return readout
