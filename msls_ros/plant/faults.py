"""Faults: what breaks in flight, when, how much of it and how fast; and which samples of a flight they touch.

A fault strikes after the first sample that is not before its time: the sample after that one is the first to feel it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Protocol

import numpy as np

from msls_ros.plant.airframe import F16_MATV
from msls_ros.plant.definition import Airframe
from msls_ros.plant.interface import PlantError

LONGEST_RAMP = 3600.0
"""[s]"""
LATEST = 1e6
"""[s]"""
_TICK = 1e-9
_WORDS: Mapping[str, bool] = MappingProxyType({"true": True, "false": False})


@dataclass(frozen=True)
class Fault:
    """One thing that breaks.

    Attributes
    ----------
    effector : str
        A surface, or an effector (all of its surfaces).
    time : float
        When [s], not negative.
    effectiveness : float
        What is left of the effect of its deflection: 1 intact, 0 lost.
    ramp : float
        Time over which effectiveness and bias change linearly from what they were [s]; 0: at once.
    stuck : bool
        The actuator stays where it is.
    bias : float
        Deflection that the fault adds to what the air feels, unmeasured [rad]; for an effector, of the effector.
    hard_over : float or None
        Where the actuator is driven, and stays, measured [rad]; for an effector, of the effector. None: it follows.
    airframe : Airframe
        What has these surfaces and effectors.

    Raises
    ------
    PlantError
        At construction, for an unknown name or a number out of range; the sentence begins with the field.
    """

    effector: str
    time: float
    effectiveness: float
    ramp: float = 0.0
    stuck: bool = False
    bias: float = 0.0
    hard_over: float | None = None
    airframe: Airframe = field(default=F16_MATV, repr=False)

    def __post_init__(self) -> None:
        """Refuse what cannot break."""
        check_damage(self.airframe, self.effector, self.effectiveness, self.bias, self.ramp, self.stuck)
        check_hard_over(self.airframe, self.effector, self.hard_over, self.stuck)
        if not (_is_number(self.time) and 0.0 <= self.time <= LATEST):
            message = f"time {self.time!r} s: expected a number from 0 to {LATEST:g}"
            raise PlantError(message)

    @property
    def surfaces(self) -> tuple[str, ...]:
        """What it damages."""
        return self.airframe.surfaces_of.get(self.effector, (self.effector,))

    def sample(self, period: float) -> int:
        """Return the number of the sample after which it strikes, samples being a period [s] apart."""
        return max(0, math.ceil((self.time - _TICK) / period))

    def left(self, time: float) -> float:
        """Return what is left of the effect of an intact surface that it damages, at a time [s]; 1 before it strikes.

        Of a ramp, what is left on its way.
        """
        if time < self.time:
            return 1.0
        part = min((time - self.time) / self.ramp, 1.0) if self.ramp > 0.0 else 1.0
        return 1.0 + part * (self.effectiveness - 1.0)

    @classmethod
    def parse(cls, text: str, airframe: Airframe = F16_MATV) -> Fault:
        """Read a fault from one line: ``left_stabilator time=4.0 effectiveness=0.5 ramp=5.0 stuck=true bias=0.01``.

        Parameters
        ----------
        text
            The effector, then ``time`` and ``effectiveness``, and where wanted ``ramp``, ``stuck``, ``bias`` and
            ``hard_over``.
        airframe
            What has that effector.

        Raises
        ------
        PlantError
            For a line that is none.
        """
        effector, _, rest = text.strip().partition(" ")
        names = [one.name for one in fields(cls)][1:-1]
        values: dict[str, float | bool] = {}
        for word in rest.split():
            name, _, value = word.partition("=")
            if name not in names or name in values:
                again = "again " if name in values else ""
                message = f"'{word}' stands {again}in the fault '{text}'; expected {_FORM}"
                raise PlantError(message)
            values[name] = _flag(word, value) if name == "stuck" else _number(word, value)
        for name in ("time", "effectiveness"):
            if name not in values:
                message = f"the fault '{text}' has no {name}; expected {_FORM}"
                raise PlantError(message)
        return cls(effector, **values, airframe=airframe)  # type: ignore[arg-type]

    def __str__(self) -> str:
        """Write the line that `parse` reads."""
        stuck = "true" if self.stuck else "false"
        return (
            f"{self.effector} time={float(self.time)!r} effectiveness={float(self.effectiveness)!r} "
            f"ramp={float(self.ramp)!r} stuck={stuck} bias={float(self.bias)!r}"
            + ("" if self.hard_over is None else f" hard_over={float(self.hard_over)!r}")
        )


_FORM = "EFFECTOR time=... effectiveness=... and where wanted ramp=... stuck=true bias=... hard_over=..."


class Damageable(Protocol):
    """What a fault strikes: an `Aircraft`."""

    def damage(
        self,
        surface_or_effector: str,
        effectiveness: float,
        bias: float = 0.0,
        *,
        ramp: float = 0.0,
        stuck: bool = False,
        hard_over: float | None = None,
    ) -> str:
        """See `Aircraft.damage`."""


class FaultSchedule:
    """The faults of one flight by sample.

    Parameters
    ----------
    faults : sequence of Fault
        Of one sample, the later ones replace the earlier.
    period : float
        Time from sample to sample [s].
    """

    def __init__(self, faults: Sequence[Fault], period: float) -> None:
        self._period = period
        self._due: dict[int, list[Fault]] = {}
        self._turns: set[int] = set()
        for fault in faults:
            sample = fault.sample(period)
            self._due.setdefault(sample, []).append(fault)
            self._add_turns(fault, sample)

    def turns(self, sample: int) -> bool:
        """Whether the truth changes its course at a sample: on either side of a fault's start and of a ramp's end."""
        return sample in self._turns

    def strike(self, sample: int, aircraft: Damageable) -> list[str]:
        """Damage the aircraft with the faults that are due after a sample; say what was done."""
        return [_strike(fault, aircraft) for fault in self._due.get(sample, ())]

    def inject(self, fault: Fault, sample: int, aircraft: Damageable) -> str:
        """Damage the aircraft after a sample, whatever the fault's time; say what was done."""
        self._add_turns(fault, sample)
        return _strike(fault, aircraft)

    def _add_turns(self, fault: Fault, sample: int) -> None:
        end = sample + fault.ramp / self._period
        self._turns |= {sample, sample + 1, math.floor(end + _TICK), math.ceil(end - _TICK)}


def _strike(fault: Fault, aircraft: Damageable) -> str:
    driven = {} if fault.hard_over is None else {"hard_over": fault.hard_over}
    return aircraft.damage(
        fault.effector, fault.effectiveness, fault.bias, ramp=fault.ramp, stuck=fault.stuck, **driven
    )


def check_damage(
    airframe: Airframe, effector: str, effectiveness: float, bias: float, ramp: float, stuck: bool
) -> tuple[str, ...]:
    """Return the surfaces of a damage.

    Raises
    ------
    PlantError
        For an unknown name or a number out of range; the sentence begins with what is wrong.
    """
    known = (*airframe.surface_names, *airframe.effectors)
    if effector not in known:
        message = f"effector {effector!r}: expected one of {', '.join(dict.fromkeys(known))}"
        raise PlantError(message)
    names = airframe.surfaces_of.get(effector, (effector,))
    if not (_is_number(effectiveness) and 0.0 <= effectiveness <= 1.0):
        message = f"effectiveness {effectiveness!r}: expected a number from 0 (lost) to 1 (intact)"
        raise PlantError(message)
    limit = airframe.surface(names[0]).actuator.high
    if not (_is_number(bias) and abs(bias) <= limit):
        message = f"bias {bias!r} rad: expected a number within +-{limit:.3f} rad"
        raise PlantError(message)
    if not (_is_number(ramp) and 0.0 <= ramp <= LONGEST_RAMP):
        message = f"ramp {ramp!r} s: expected a number from 0 to {LONGEST_RAMP:g}"
        raise PlantError(message)
    if not isinstance(stuck, bool):
        message = f"stuck {stuck!r}: expected True or False"
        raise PlantError(message)
    return names


def check_hard_over(airframe: Airframe, effector: str, hard_over: float | None, stuck: bool) -> None:
    """Refuse a position that an actuator cannot be driven to.

    Raises
    ------
    PlantError
        For a number out of range, or a surface that is stuck too; the sentence begins with what is wrong.
    """
    if hard_over is None:
        return
    actuator = airframe.surface(airframe.surfaces_of.get(effector, (effector,))[0]).actuator
    if not (_is_number(hard_over) and actuator.low <= hard_over <= actuator.high):
        message = f"hard_over {hard_over!r} rad: expected a number from {actuator.low:.3f} to {actuator.high:.3f}"
        raise PlantError(message)
    if stuck:
        message = f"hard_over {hard_over!r} rad: expected none for a surface that is stuck, or not stuck"
        raise PlantError(message)


def check_faults(faults: Sequence[Fault], name: str = "faults") -> None:
    """Refuse faults that are not in order of time, or that break one surface twice at one time.

    Parameters
    ----------
    faults
        Of one flight.
    name
        What the sentence calls them.

    Raises
    ------
    PlantError
        The sentence begins with the fault: ``faults[1]``.
    """
    for i, fault in enumerate(faults):
        for j, earlier in enumerate(faults[:i]):
            if earlier.time > fault.time:
                message = f"{name}[{i}].time {fault.time:g} s: expected no earlier than {name}[{j}], {earlier.time:g} s"
                raise PlantError(message)
            both = set(fault.surfaces) & set(earlier.surfaces)
            if both and earlier.time == fault.time:
                message = (
                    f"{name}[{i}].effector {fault.effector!r} at {fault.time:g} s: expected one fault on "
                    f"{min(both)} at a time, {name}[{j}] is another"
                )
                raise PlantError(message)


def _is_number(value: object) -> bool:
    number = isinstance(value, (int, float, np.floating, np.integer)) and not isinstance(value, bool)
    return number and math.isfinite(value)  # type: ignore[arg-type]


def _number(word: str, value: str) -> float:
    try:
        return float(value)
    except ValueError:
        message = f"'{word}': expected a number after the ="
        raise PlantError(message) from None


def _flag(word: str, value: str) -> bool:
    if value not in _WORDS:
        message = f"'{word}': expected stuck=true or stuck=false"
        raise PlantError(message)
    return _WORDS[value]
