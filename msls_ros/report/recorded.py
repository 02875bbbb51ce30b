"""What a report is made of: one recorded flight as arrays, every part of which may be missing.

Times are seconds from the flight's origin; SI units and radians. n states, m effectors, p regressors, r identified
equations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
DITHER_LEVELS = ("off", "nominal", "boosted", "inhibited")
"""Names of the levels, by the number in the message."""


@dataclass(frozen=True)
class Signals:
    """Named values over time."""

    time: Array
    """(k,) [s]."""
    names: tuple[str, ...]
    values: Array
    """(k, len(names)); NaN where the message had none."""


@dataclass(frozen=True)
class Models:
    """The published models; k of them."""

    time: Array
    states: tuple[str, ...]
    effectors: tuple[str, ...]
    regressors: tuple[str, ...]
    a: Array
    """(k, n, n) [state per second per state]."""
    b: Array
    """(k, n, m) [state per second per rad]."""
    a_std: Array
    b_std: Array
    """Standard errors; infinite or NaN: none can be given."""
    a_known: Flags
    """(n, n) filled in from physics."""
    a_reliable: Flags
    b_reliable: Flags
    """(k, n, n), (k, n, m)."""
    excitation: Array
    """(k, p) share of each parameter that the data decide."""
    residual_std: Array
    """(k, n); NaN: the equation is known."""
    delay: float = 0.0
    """By how much the last one says that responses come after deflections [s]."""
    lag: float = 0.0
    """And the lag of deflections that it found, 0: none [s]."""
    state_delay: Array = field(default_factory=lambda: np.zeros(0))
    """(n,) and by how much velocities come after their derivatives [s]."""
    stride: int = 1
    """Every which of the published models is held here."""

    @property
    def identified(self) -> list[int]:
        """Rows that are identified."""
        return [int(i) for i in np.flatnonzero(np.isfinite(self.residual_std).any(axis=0))]


@dataclass(frozen=True)
class Truth:
    """The plant's own model, in the order of the names of `Models`; k of them."""

    time: Array
    a: Array
    b: Array


@dataclass(frozen=True)
class Dither:
    """The dither commands; k of them."""

    time: Array
    effectors: tuple[str, ...]
    delta: Array
    """(k, m) [rad]."""
    predicted: Array
    limit: Array
    """(k,) rms acceleration at the pilot and its limit [g]."""
    level: NDArray[np.int64]
    """(k,) index of `DITHER_LEVELS`."""
    reasons: Mapping[str, int]
    """How many commands gave which reason."""
    realised: Array | None = None
    """(k,) rms over 1 s of the acceleration by the dither alone, through the true B [g]."""


@dataclass(frozen=True)
class Event:
    """One fault event."""

    time: float
    kind: str
    """detected, isolated or recovered."""
    equations: tuple[str, ...]
    statistic: tuple[float, ...]
    threshold: tuple[float, ...]
    effector: str
    effectiveness: float
    effectiveness_std: float
    description: str


ONE_CHANGE = 0.5
"""An alarm of other equations so soon after one, before anything is named or recovered, is of the same change [s]."""


def joined(events: Sequence[Event]) -> list[Event]:
    """Return events with the alarms of one change as one: a change shows in each equation after a time of its own.

    Parameters
    ----------
    events
        In the order of time.
    """
    found: list[Event] = []
    for event in events:
        first = found[-1] if found else None
        one = (
            first is not None
            and (first.kind, event.kind) == ("detected", "detected")
            and event.time - first.time <= ONE_CHANGE
            and not set(first.equations) & set(event.equations)
        )
        if first is not None and one:
            later = f"{', '.join(f'd{name}/dt' for name in event.equations)} {event.time - first.time:.2f} s later"
            found[-1] = replace(
                first,
                equations=first.equations + event.equations,
                statistic=first.statistic + event.statistic,
                threshold=first.threshold + event.threshold,
                description=f"{first.description}; {later}",
            )
        else:
            found.append(event)
    return found


@dataclass(frozen=True)
class Detection:
    """Prediction errors and change statistics, computed again by the same identifier; k samples."""

    time: Array
    rows: tuple[str, ...]
    error: Array
    """(k, r) [state per second]."""
    statistic: Array
    """(k, r) [1]; 0 while the detector is not armed."""
    threshold: float
    enabled: bool
    """Whether the configuration asks for detection."""


@dataclass(frozen=True)
class TruthChange:
    """An abrupt change of the plant's own B."""

    time: float
    """Of the last model before it [s]."""
    effects: tuple[tuple[str, str, float], ...]
    """Effector, equation, and how much of the effect is left, for each effector that changed."""


@dataclass(frozen=True)
class Refusals:
    """Messages that were refused."""

    source: str
    """Who counted them, in words."""
    counts: Mapping[str, int]
    """By reason."""
    examples: Mapping[str, str] = field(default_factory=dict)
    """The first refusal of each reason, in words, where that is known."""


@dataclass(frozen=True)
class Setting:
    """One parameter of the configuration."""

    name: str
    value: str
    unit: str
    description: str


@dataclass(frozen=True)
class Equation:
    """One identified equation, predicted one sample ahead; k samples."""

    name: str
    time: Array
    measured: Array
    predicted: Array
    """(k,) derivative of the state, gravity taken off where it is known."""
    r2: float
    """Share of the measured variance that is predicted."""
    white: float
    """Share of the residual's autocorrelations, lags 1 to 20, within the band of white noise."""
    excited: bool = True
    """Whether there was anything to predict beyond noise."""


@dataclass(frozen=True)
class Trust:
    """Why to believe the model, or not."""

    equations: Sequence[Equation]
    batch_span: tuple[float, float] | None = None
    """Of the least squares over all samples of a span, which the best known numbers are compared with [s]."""
    inside: int = 0
    compared: int = 0
    """How many numbers are within the 95 % band of both, of how many."""


@dataclass(frozen=True)
class Finding:
    """What the check of the data found."""

    level: str
    """wrong, doubtful or note."""
    where: str
    what: str
    change: str


@dataclass(frozen=True)
class Recorded:
    """All of it."""

    name: str
    """Of the bag."""
    origin: str
    """What time 0 is, in words."""
    topics: Sequence[tuple[str, str, int | None]]
    """Name, type and count."""
    warnings: Sequence[str] = ()
    missing: Sequence[str] = ()
    """What the bag does not hold, one sentence each."""
    states: Signals | None = None
    deflections: Signals | None = None
    models: Models | None = None
    models_source: str = ""
    """Where the models are from, in words."""
    truth: Truth | None = None
    dither: Dither | None = None
    events: Sequence[Event] = ()
    detection: Detection | None = None
    agreement: str = ""
    """How what was computed again compares with what was recorded, in words."""
    trust: Trust | None = None
    findings: Sequence[Finding] = ()
    refusals: Sequence[Refusals] = ()
    samples: int | None = None
    """Pairs of state and deflection that passed the gate."""
    settings: Sequence[Setting] = ()
    settings_source: str = ""
    scenario: str = ""
    """What was flown, in words, where that is known."""
    versions: Mapping[str, str] = field(default_factory=dict)

    @property
    def span(self) -> tuple[float, float]:
        """First and last time of all that is here [s]."""
        parts = (self.states, self.deflections, self.models, self.dither, self.detection, self.truth)
        times = [part.time for part in parts if part is not None and len(part.time)]
        if not times:
            return 0.0, 1.0
        return float(min(t[0] for t in times)), float(max(t[-1] for t in times))

    @property
    def alarms(self) -> list[Event]:
        """The events of detection."""
        return [event for event in self.events if event.kind == "detected"]

    @property
    def alarmed_changes(self) -> list[Event]:
        """The events of detection, those of one change as one."""
        return [event for event in joined(self.events) if event.kind == "detected"]
