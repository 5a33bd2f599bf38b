"""Eight readouts as technicians noted them, of simulated lines whose truth is beside them.

A cause is right among the first three, and first where it leads by three points; an interval that holds
the truth; a field of a profile that has the truth's value, or is open.
"""

import json
from pathlib import Path

import pytest

import bussim

CASES = Path(__file__).parent / "cases"


@pytest.mark.parametrize("name", sorted(path.stem for path in CASES.glob("*.yaml")))
def test_a_readout_tells_its_truth(name: str) -> None:
    truth = json.loads((CASES / f"{name}.truth.json").read_text("utf-8"))
    found = bussim.site(CASES / f"{name}.yaml").to_dict()
    if truth["command"] == "diagnose":
        causes = [each["cause"] for each in found["causes"][:3]]
        assert truth["cause"] in causes
        scores = [each["score"] for each in found["causes"]]
        assert causes[0] == truth["cause"] or scores[0] - scores[1] < 3
    elif truth["command"] == "infer":
        for k, fails in truth["attempt_fails"].items():
            told = found["stations"][k]["attempt_fails"]
            assert told["low"] <= fails <= told["high"]
        assert not (truth["memoryless"] and found["bursts"] == "seen")
    else:
        assert {key: value for key, value in found["fields"].items() if value is not None} == truth["fields"]
        for key, value in truth["continuous_ms"].items():
            assert found["times_ms"][key]["low"] <= value <= found["times_ms"][key]["high"]
