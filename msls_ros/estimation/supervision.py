"""What follows an alarm: events when the change is isolated and when the equations have recovered."""

from __future__ import annotations

import math

import numpy as np

from msls_ros.estimation.bank.isolation import SLOW, Decision, Losses, Name, find_name
from msls_ros.estimation.bank.regression import BankRegression
from msls_ros.estimation.bank.settings import LOSSES, THRESHOLD
from msls_ros.estimation.configuration import Configuration
from msls_ros.estimation.engine import Engine
from msls_ros.estimation.estimate import EventKind, FaultEvent
from msls_ros.estimation.isolation import Suspect, suspects
from msls_ros.estimation.kernel import Array, Integers
from msls_ros.estimation.regression import Regression
from msls_ros.estimation.soundness import ABSURD, MISFIT, NOT_FINITE, PACE, RESPONSE
from msls_ros.estimation.surfaces import read_surfaces

_REASONS = {
    NOT_FINITE: "with these samples and settings its numbers left the range of what can be computed",
    MISFIT: "for long its predictions were absurd, more than ten times what was measured",
    ABSURD: "it had taken samples larger than any of an aircraft (more than 1e6 in SI units), and their like has ended",
    RESPONSE: "aircraft and records say that deflections act after",
    PACE: "samples come at another rate, for which nothing that was learnt is kept",
}

HELD = 3
"""Samples, beyond one for two regressors, for which a name must stand before it is given."""
RECOVERY = 4
"""Samples, for one regressor, after an alarm, before which no row has recovered; its own is the first of them."""
LONGEST = 60.0
"""For so long at most what may have been lost waits for an input that shows what is left of it [s]."""
MEMORY = LOSSES[-1].memory
"""Of the member that says what is left [s]."""


class Supervisor:
    """Turn alarms into events, and watch the rows concerned until they are isolated and recovered.

    Parameters
    ----------
    configuration
        Names, thresholds and limits.
    """

    def __init__(self, configuration: Configuration) -> None:
        """Watch nothing yet; see the class."""
        self.configure(configuration)
        self.reset()

    def configure(self, configuration: Configuration) -> None:
        """Take over changed parameters."""
        self._c = configuration
        bank = configuration.estimator.method == "bank"
        self._offset = 0.0 if bank or configuration.detector.mode == "ratio" else 1.0
        self._threshold = THRESHOLD if bank else configuration.detector.threshold
        self._bank = bank
        self._surfaces = read_surfaces(configuration.isolation.surfaces, configuration.effectors)

    def reset(self) -> None:
        """Forget all alarms."""
        self.alarms = 0
        """Alarms since the reset."""
        self.drop()

    @property
    def watching(self) -> bool:
        """Whether `follow` has anything to do."""
        return bool(self._isolating or self._recovering)

    def statistic(self, raw: Array) -> Array:
        """Return the published statistic: eq 19 subtracts the mean, the loop's short/long does not; 0: not armed."""
        return np.where(raw > 0.0, raw - self._offset, 0.0) if self._offset else np.fmax(raw, 0.0)

    def alarm(self, time: float, statistic: Array, alarm: Integers, regression: Engine) -> FaultEvent:
        """Return the event of an alarm and watch its rows.

        Parameters
        ----------
        time
            Of the sample [s].
        statistic, alarm
            (r,) of the sample.
        regression
            What alarmed.
        """
        self.alarms += 1
        self._tried = 0.0
        if isinstance(regression, BankRegression):
            regression.mark(bool(self._isolating))
        found = [q for q in range(len(alarm)) if alarm[q]]
        for q in found:
            self._isolating.setdefault(q, time)
            self._recovering[q] = time
        names = tuple(self._c.rows[q] for q in found)
        values = tuple(float(statistic[q]) - self._offset for q in found)
        equations = ", ".join(f"d{n}/dt" for n in names)
        text = f"abrupt change in {equations}, detected at {time:.3f} s"
        limits = (self._threshold,) * len(found)
        return FaultEvent(time, EventKind.DETECTED, names, values, limits, description=text)

    def restart(self, time: float, why: int, regression: Engine) -> FaultEvent:
        """Return the event of an estimator that has begun anew; nothing is watched any more.

        Parameters
        ----------
        time
            Of the sample [s].
        why
            See `soundness`.
        regression
            What has begun anew.
        """
        self.drop()
        reason = _REASONS[why]
        if why == RESPONSE:
            reason += f" {1e3 * regression.delay[0]:.0f} ms, and a lag of {1e3 * regression.lag:.0f} ms"
        text = f"the estimate begins anew at {time:.3f} s: {reason}"
        return FaultEvent(time, EventKind.RESET, tuple(self._c.rows), (), (), description=text)

    def drop(self) -> None:
        """Watch nothing any more; the count of alarms stays."""
        self._isolating: dict[int, float] = {}
        self._recovering: dict[int, float] = {}
        self._tried = 0.0
        slow = round(SLOW * self._c.sample_rate)
        self._decision = Decision(HELD + len(self._c.regressors) // 2, slow, MEMORY / SLOW)

    def follow(self, time: float, regression: Engine) -> list[FaultEvent]:
        """Return what the sample at ``time`` says of the alarms that are watched."""
        return [*self._isolate(time, regression), *self._recover(time, regression)]

    def _isolate(self, time: float, regression: Engine) -> list[FaultEvent]:
        """Name what changed, for every row for which it is clear by now; give up after the window."""
        if self._bank:
            return self._name(time, regression)
        found: dict[int, list[tuple[int, Suspect]]] = {}
        for q, since in sorted(self._isolating.items()):
            named = self._suspects(regression, q)
            for suspect in named[:1]:
                found.setdefault(suspect.column, []).append((q, suspect))
            if named or time - since > self._c.isolation.window:
                del self._isolating[q]
                regression.settle(q)
        return [self._isolated(time, column, each) for column, each in sorted(found.items())]

    def _name(self, time: float, regression: Engine) -> list[FaultEvent]:
        """Name the surface that explains what changed in all rows, once that is decided; give up after the window."""
        limits = self._c.isolation
        least = (limits.least_samples - 0.5) / self._c.sample_rate
        found = [q for q, since in sorted(self._isolating.items()) if time - since >= least]
        candidate = None
        if found and isinstance(regression, BankRegression):
            said = regression.losses(found)
            candidate = self._candidate(said, found, regression)
            if not regression.undecided(found, said):
                self._tried += 1.0 / self._c.sample_rate
        begun = self._begun(time, regression)
        name = self._decision.take(candidate, len(begun) == len(self._isolating))
        if name is not None and isinstance(regression, BankRegression):
            surface, since = self._index_of(name), min(self._isolating.values())
            regression.restore(begun, surface)
            regression.spread(sorted(self._isolating), surface, name.left - 1.0, name.error, time - since)
        for q, since in sorted(self._isolating.items()):
            given_up = self._tried > limits.window or time - since > max(LONGEST, limits.window)
            if (name is not None and q in found) or given_up:
                del self._isolating[q]
                regression.settle(q)
        if not self._isolating:
            self._decision.clear()
            self._tried = 0.0
        if name is None:
            return []
        rows = tuple(self._c.rows[q] for q in found)
        text = (
            f"{name.surface} has {name.left:.2f} +- {name.error:.2f} of its effect on "
            f"{', '.join(f'd{r}/dt' for r in rows)} since the alarm"
        )
        of = (name.statistic,), (limits.significance,)
        return [FaultEvent(time, EventKind.ISOLATED, rows, *of, name.surface, name.left, name.error, text)]

    def _candidate(self, said: Losses, rows: list[int], regression: BankRegression) -> Name | None:
        """Return the surface that explains what changed in rows that alarmed, if the others do not deny it."""
        name = find_name(said, self._surfaces, self._c.isolation)
        if name is None or regression.denies(rows, self._index_of(name), name.left - 1.0):
            return None
        return name

    def _index_of(self, name: Name) -> int:
        """Return which surface is named."""
        return [one.name for one in self._surfaces].index(name.surface)

    def _begun(self, time: float, regression: Engine) -> list[int]:
        """Return the rows that are watched and have begun anew since their alarm."""
        rate = self._c.sample_rate
        return [q for q, since in sorted(self._isolating.items()) if regression.age(q) < (time - since) * rate + 1.5]

    def _suspects(self, regression: Engine, q: int) -> list[Suspect]:
        """Return the columns that changed in row q: effectors, or else states, within the limits."""
        limits, p = self._c.isolation, regression.theta.shape[1]
        if regression.age(q) < p + limits.least_samples:
            return []
        assert isinstance(regression, Regression)
        d = regression.difference(q)
        first = len(self._c.rows)
        effectors, states = range(first, p - 1), range(first)
        for candidates in (effectors, states):
            named = suspects(
                d.before_covariance + d.since_covariance,
                d.before,
                np.sqrt(np.maximum(np.diagonal(d.before_covariance), 0.0)),
                d.since,
                candidates,
                significance=limits.significance,
                explained=limits.explained,
                largest_error=limits.largest_error,
            )
            if named:
                return named
        return []

    def _isolated(self, time: float, column: int, named: list[tuple[int, Suspect]]) -> FaultEvent:
        """Return the event for one column, its effectiveness averaged over the rows that name it."""
        weights = [1.0 / max(s.effectiveness_std, 1e-12) ** 2 for _, s in named]
        total = math.fsum(weights)
        effectiveness = math.fsum(w * s.effectiveness for w, (_, s) in zip(weights, named, strict=True)) / total
        error = 1.0 / math.sqrt(total)
        name = self._c.regressors[column]
        rows = tuple(self._c.rows[q] for q, _ in named)
        kind = "effector" if name in self._c.effectors else "state"
        text = (
            f"the {kind} {name} has {effectiveness:.2f} +- {error:.2f} of its effect on "
            f"{', '.join(f'd{r}/dt' for r in rows)} since the alarm"
        )
        statistics = tuple(s.statistic for _, s in named)
        limits = (self._c.isolation.significance,) * len(named)
        return FaultEvent(time, EventKind.ISOLATED, rows, statistics, limits, name, effectiveness, error, text)

    def _recover(self, time: float, regression: Engine) -> list[FaultEvent]:
        """Return the event of the rows that are back at normal settings since their last alarm.

        Where a loss is taken into the estimate as it stands (`losses`), a row does not begin anew; that is no recovery
        yet, which takes as many samples there as elsewhere.
        """
        least = (RECOVERY * len(self._c.regressors) - 1.5) / self._c.sample_rate
        done = [q for q, since in sorted(self._recovering.items()) if time - since > least and regression.recovered(q)]
        if not done:
            return []
        for q in done:
            del self._recovering[q]
        rows = tuple(self._c.rows[q] for q in done)
        text = f"{', '.join(f'd{r}/dt' for r in rows)}: the estimate is back at its normal settings"
        return [FaultEvent(time, EventKind.RECOVERED, rows, (), (), description=text)]
