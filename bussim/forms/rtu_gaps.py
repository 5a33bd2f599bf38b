"""The form of the silences of Modbus RTU, of a PLC's profile or of a device."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, ClassVar

from pydantic import model_validator

from bussim.engines.modbus.gaps import STANDARD_GAPS, GapRule
from bussim.forms.fields import exact, fail, none_or, number, time
from bussim.forms.form import Model, changed
from bussim.units import TICKS_PER_SECOND
from bussim.words.language import say


class RtuGapsIn(Model):
    """Silences in characters; what is left out stays as it is."""

    example = "{end: 4.5, inner: 1.5, fast_character: none}"
    #: What is changed.
    base: ClassVar[GapRule] = STANDARD_GAPS

    end: Annotated[float, number(0.1, 1000)] | None = None
    inner: Annotated[float | str, none_or(number(0.1, 1000))] | None = None
    fast_character: Annotated[int | str, none_or(time(1, TICKS_PER_SECOND))] | None = None

    @model_validator(mode="after")
    def _in_order(self) -> RtuGapsIn:
        rule = self.rule()
        inner, end = float(rule.inner), float(rule.end)
        if inner > end:
            if self.inner is not None:
                raise fail(say("form_more_than_end", inner=inner, end=end), "inner")
            raise fail(say("form_less_than_inner", end=end, inner=inner), "end")
        return self

    def rule(self) -> GapRule:
        """The rule with the given fields changed; with ``inner: none`` what ends no frame may be in it."""
        fast = {"fast_character": None} if self.fast_character == "none" else {}
        found = changed(self.base, {**self.given("inner"), **fast})
        if self.inner is None:
            return found
        return replace(found, inner=found.end if isinstance(self.inner, str) else exact(self.inner))
