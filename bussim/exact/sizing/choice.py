"""One setting of a link with its figures, and the least that meets the goals."""

from dataclasses import dataclass

from bussim.exact.link import TIMEOUT_UNIT, LinkModel
from bussim.exact.sizing.evaluation import evaluate_goals, least, rows_of
from bussim.exact.sizing.goals import Goals
from bussim.exact.sizing.grid import Grid
from bussim.exact.text import in_ms
from bussim.plc.profiles import Attempts, attempts_per_poll


@dataclass(frozen=True, slots=True)
class Choice:
    """One setting and its figures. ``timeout`` in ticks; other times in ticks too.

    The figures are the worst of all noise under which the goals must be met. ``errors`` are false station
    errors a year of all stations together, ``onsets`` how often one begins, ``dead`` the mean scan with one
    station dead, ``detect`` the mean time to notice that, ``ride`` the longest interruption of the line that
    raises no error.
    """

    retries: int
    timeout: int
    attempts: int
    mean: float
    errors: float
    onsets: float
    dead: float
    detect: float
    detect_longest: float
    ride: float

    @property
    def d8180(self) -> int:
        """D8180: the timeout in 10 ms."""
        return self.timeout // TIMEOUT_UNIT

    def to_json(self) -> dict[str, object]:
        """The setting and its figures, times in ms."""
        return {
            "D8179": self.retries,
            "D8180": self.d8180,
            "attempts": self.attempts,
            "mean_ms": in_ms(self.mean),
            "false_errors_per_year": self.errors,
            "false_error_onsets_per_year": self.onsets,
            "one_dead_ms": in_ms(self.dead),
            "detect_ms": {"mean": in_ms(self.detect), "max": in_ms(self.detect_longest)},
            "ride_through_ms": in_ms(self.ride),
        }


def recommend(
    model: LinkModel, goals: Goals, *, alone: bool = False, lines: tuple[LinkModel, ...] = ()
) -> Choice | None:
    """The least setting of a link that meets all goals, None where none does (:func:`evaluate_goals`)."""
    checked = evaluate_goals(model, goals, alone=alone, lines=lines)
    found = least([(checked, rows_of(checked, model.reading))])
    if found is None:
        return None
    return choice_of(checked.grid, model.reading, found[0], checked.grid.timeouts[found[1]])


def choice_of(grid: Grid, reading: Attempts, retries: int, timeout: int) -> Choice:
    """A setting (``timeout`` in ticks) with its figures."""
    attempts = attempts_per_poll(reading, retries)
    i, j = grid.at(attempts, timeout)
    times = grid.one_dead, grid.detect_mean, grid.detect_longest, grid.silence
    figures = (float(values[i, j]) for values in (grid.mean, grid.errors, grid.onsets, *times))
    return Choice(retries, timeout, attempts, *figures)
