"""The paper's F-16 flights (Figs 7-9) on many seeds: flown in closed loop, identified, and measured against truth.

* dPdot/dw (Figs 7-8; a41 in the text, by eq 25 a43). In the paper's two-pound doublet the regressors do not move enough
  to identify this parameter, so an exciting manoeuvre stands for it: the doublet at 20 deg/s instead of 6, over a sine
  of the angle of attack of 3 deg at 1 Hz, noise-free at 100 Hz. The light doublet, a slow sine and low noise are flown
  too, to say what becomes of it there.
* b43, dPdot/d ddt (Fig 9): the paper's doublet, the left stabilator lost at 4.0 s, noise-free and with low noise.

The seed is that of the dither and of the sensors. Every estimator sees the same samples; MSLS flies.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation import Configuration, Estimate, Level
from msls_ros.flights.closed_loop import Flight, FlightLog, Rates, fly
from msls_ros.flights.comparison import Comparison, realised_acceleration, summarise
from msls_ros.flights.judging import PEERS, START
from msls_ros.flights.scenarios import find_scenario
from msls_ros.flights.watch import Watch
from msls_ros.inputs.profiles import read_profile
from msls_ros.plant import STATES, Manoeuvre, RollDoublet, StrongManoeuvre

Array = NDArray[np.float64]

ROLL, HEAVE = STATES.index("P"), STATES.index("w")
MOST_EXCITING, FEW, VARIATIONS = 10, 3, 4
"""Flights of Figs 7-8, and of each of the variations of them."""
UNDITHERED = 5
"""Flights without dither in noise; noise-free they are all alike, and one will do."""
DURATION = 12.0
"""[s]"""
EXCITING_RATES = Rates(sensors=100, truth=25)
"""Of Figs 7-8."""
EXCITING_PENALTY = 1e-4
NOISES = ("none", "low")
SCENARIO = find_scenario("roll_doublet_tail_fault")
LITERAL_DETECTOR: Mapping[str, Any] = {
    "detector.mode": "paper",
    "detector.window": 10,
    "detector.threshold": 20.0,
}
"""The paper's settings of the detector on the F-16."""
MSLS: Mapping[str, Any] = {"estimator.method": "msls", "sample_rate": 50.0}
MSLS_BY_NOISE: Mapping[str, Mapping[str, Any]] = {
    "none": {"estimator.penalty": 3e-4},
    "low": {"estimator.forgetting_factor": 0.96, "estimator.penalty": 9e-4, "recovery.penalty_factor": 0.3},
}
"""MSLS wants its settings by noise: looking back 25 samples halves the error of low noise in a quiet flight."""
LITERAL_DITHER: Mapping[str, Any] = {"dither.acceleration": "worst_case", "dither.allocation": "equal"}
"""Eq 23 as it stands: the flights of the paper are flown with its dither."""


def exciting_manoeuvre(alpha_period: float = 1.0) -> StrongManoeuvre:
    """Return the exciting manoeuvre: the paper's doublet in time (1, 5, 9 s), stronger, over a moving alpha."""
    return StrongManoeuvre(math.radians(20.0), 1.0, 4.0, 4.0, math.radians(3.0), 0.0, alpha_period)


def exciting_estimators() -> dict[str, Configuration]:
    """Return the estimators of Figs 7-8: with gravity known, and in the paper's form of nine states as regressors.

    Both have the constant that the `Identifier` always has and eq 24 lacks.
    """
    known, literal = (
        read_profile(name).replace(
            {
                **MSLS,
                "sample_rate": float(EXCITING_RATES.sensors),
                "estimator.penalty": EXCITING_PENALTY,
                **LITERAL_DITHER,
            }
        )
        for name in ("f16", "paper_literal")
    )
    rls = PEERS["msls"]["rls"]
    return {
        "msls": known,
        "msls_nine": literal,
        "rls": known.replace(rls),
        "rls_nine": literal.replace(rls),
    }


@dataclass(frozen=True)
class Exciting:
    """Estimates of dPdot/dw over s flights of n samples."""

    time: Array
    """(n,) [s]."""
    truth: Array
    """(s, n) [rad/s^2 per m/s]."""
    estimates: Mapping[str, Array]
    """(s, n) of each of `exciting_estimators`."""
    reliable: float
    """Share of the samples at which MSLS calls it reliable."""
    alpha: tuple[float, float]
    """Least and largest angle of attack [rad]."""

    def relative_error(self, name: str) -> Array:
        """(s,) rms error over the range of the truth, from 1 s on."""
        late = self.time >= START
        error, truth = (self.estimates[name] - self.truth)[:, late], self.truth[:, late]
        found: Array = np.sqrt(np.mean(error**2, axis=1)) / np.ptp(truth, axis=1)
        return found

    def correlation(self, name: str) -> Array:
        """(s,) correlation with the truth, from 1 s on."""
        late = self.time >= START
        pairs = zip(self.estimates[name][:, late], self.truth[:, late], strict=True)
        return np.array([np.corrcoef(one, other)[0, 1] for one, other in pairs])

    @property
    def zero_error(self) -> Array:
        """(s,) rms error over range of an estimate that is always zero."""
        truth = self.truth[:, self.time >= START]
        found: Array = np.sqrt(np.mean(truth**2, axis=1)) / np.ptp(truth, axis=1)
        return found


def run_exciting(
    seeds: int,
    manoeuvre: Manoeuvre,
    *,
    noise: str = "none",
    penalty: float = EXCITING_PENALTY,
    names: tuple[str, ...] = ("msls", "msls_nine", "rls", "rls_nine"),
    done: Callable[[], None] = lambda: None,
) -> Exciting:
    """Fly for dPdot/dw with seeds 0, 1, ...

    Parameters
    ----------
    seeds
        How many.
    manoeuvre
        The pilot's.
    noise
        Of the sensors.
    penalty
        W0 of MSLS [1].
    names
        Which of `exciting_estimators`; ``msls`` flies, and is among them.
    done
        Called after each flight.
    """
    logs: list[FlightLog] = []
    found: dict[str, list[Array]] = {name: [] for name in names}
    for seed in range(seeds):
        estimators = {
            name: one.replace({"dither.seed": seed, "estimator.penalty": penalty})
            for name, one in exciting_estimators().items()
        }
        log = fly(estimators["msls"], Flight(noise, seed, DURATION, manoeuvre, rates=EXCITING_RATES))
        for name in names:
            estimates = log.estimates if name == "msls" else log.identify(estimators[name])
            found[name].append(np.array([one.a[ROLL, HEAVE] for one in estimates]))
        logs.append(log)
        done()
    alpha = np.array([[math.atan2(x[2], x[0]) for x in log.x] for log in logs])
    return Exciting(
        np.array(logs[0].time),
        np.array([log.truth(lambda truth: truth.a)[:, ROLL, HEAVE] for log in logs]),
        {name: np.array(one) for name, one in found.items()},
        float(np.mean([[one.a_reliable[ROLL, HEAVE] for one in log.estimates] for log in logs])),
        (float(alpha.min()), float(alpha.max())),
    )


def compare_log(log: FlightLog, estimates: Mapping[str, list[Estimate]], watch: Watch) -> Comparison:
    """Put a flight in the form in which the demo's are summarised.

    Parameters
    ----------
    log
        The flight; its truths must surround the fault.
    estimates
        Of other estimators than the one that flew, one per sample.
    watch
        The parameter to compare.
    """
    b = log.truth(lambda truth: truth.b)
    x, time, flown = np.array(log.x), np.array(log.time), log.estimates
    dither = np.array([one.dither.delta for one in flown])
    return Comparison(
        time=time,
        truth=log.truth(lambda truth: watch.of(truth.a, truth.b)),
        estimates={
            name: np.array([watch.of(one.a, one.b) for one in found])
            for name, found in {"msls": flown, **estimates}.items()
        },
        std=np.array([watch.of(one.a_std, one.b_std) for one in flown]),
        reliable=np.array([watch.of(one.a_reliable, one.b_reliable) for one in flown]),
        alpha=np.arctan2(x[:, 2], x[:, 0]),
        beta=np.arcsin(x[:, 1] / np.linalg.norm(x[:, :3], axis=1)),
        x=x,
        delta=np.array(log.delta),
        dither=dither,
        dither_rms=np.array([one.dither.rms for one in flown]),
        predicted=np.array([one.dither.predicted_acceleration for one in flown]),
        limit=np.array([one.dither.acceleration_limit for one in flown]),
        realised=realised_acceleration(time, dither, b),
        boosted=np.array([one.dither.level == Level.BOOSTED for one in flown]),
        events=[(one.time, one.kind.name.lower(), one.equations) for one in log.events],
    )


@dataclass(frozen=True)
class Loss:
    """A flight that loses its left stabilator: b43, and what `summarise` says of it; n samples."""

    time: Array
    """(n,) [s]."""
    truth: Array
    """(n,) b43 [1/s^2]."""
    estimates: Mapping[str, Array]
    """(n,) of msls, msls_no_detection, rls and bank."""
    summary: Mapping[str, Any]
    alarms: tuple[float, ...]
    """[s]"""
    literal_alarms: tuple[float, ...] = ()
    """The same of the paper's detector settings [s]."""

    def error(self, name: str, quantity: str) -> float:
        """Return a number of an estimator of b43, as `summarise` names them."""
        return float(self.summary["b43"][name][quantity])

    @property
    def delay(self) -> float:
        """Time from the loss to its detection [s]; infinite where there is none."""
        found = self.summary["detection"]["delay_s"]
        return math.inf if found is None else float(found)


def fly_loss(noise: str, seed: int, dither: bool = True) -> Loss:
    """Fly the paper's doublet with the loss at 4.0 s, as the demo does but without messages.

    Parameters
    ----------
    noise, seed
        Of the sensors; the seed also of the dither.
    dither
        Inject noise.
    """
    configuration = SCENARIO.configuration(noise, seed, dither)
    configuration = configuration.replace({**MSLS, **MSLS_BY_NOISE[noise], **LITERAL_DITHER})
    log = fly(configuration, SCENARIO.flight(noise, seed))
    others = {**PEERS["msls"], "bank": {"estimator.method": "bank"}}
    peers = {name: log.identify(configuration.replace(changes)) for name, changes in others.items()}
    compared = compare_log(log, peers, SCENARIO.watch)
    literal: tuple[float, ...] = ()
    if dither:
        again = log.identify(configuration.replace(LITERAL_DETECTOR))
        literal = tuple(replace(log, estimates=again).alarms())
    return Loss(
        compared.time,
        compared.truth,
        compared.estimates,
        summarise(SCENARIO, compared),
        tuple(log.alarms()),
        literal,
    )


@dataclass(frozen=True)
class Flights:
    """Everything that was flown."""

    seeds: int
    """Flights with the loss per noise level."""
    exciting: Exciting
    """Figs 7-8."""
    variations: Mapping[str, Exciting]
    """The same with one thing changed."""
    losses: Mapping[str, list[Loss]]
    """Fig 9, by noise."""
    undithered: Mapping[str, list[Loss]]
    """The same without dither."""


def variations(done: Callable[[], None]) -> dict[str, Exciting]:
    """Fly for dPdot/dw where it is harder to identify."""
    both = ("msls", "rls_nine")
    return {
        "the paper's light doublet": run_exciting(FEW, RollDoublet(), names=both, done=done),
        "a sine of alpha of 3 s": run_exciting(FEW, exciting_manoeuvre(3.0), names=both, done=done),
        "the paper's W0 of 0.01": run_exciting(FEW, exciting_manoeuvre(), penalty=0.01, names=both, done=done),
        "low noise (W0 1e-3)": run_exciting(
            FEW, exciting_manoeuvre(), noise="low", penalty=1e-3, names=both, done=done
        ),
    }


def flights_of(seeds: int) -> int:
    """Return the flights with the loss per noise level that go with a number of linear seeds."""
    return max(FEW, seeds // 2)


def count_flights(seeds: int) -> int:
    """Return how many flights `run_flights` flies."""
    return min(seeds, MOST_EXCITING) + VARIATIONS * FEW + len(NOISES) * seeds + 1 + min(seeds, UNDITHERED)


def run_flights(seeds: int, done: Callable[[], None] = lambda: None) -> Flights:
    """Fly everything.

    Parameters
    ----------
    seeds
        Flights with the loss per noise level.
    done
        Called after each flight.
    """

    def losses(noise: str, count: int, dither: bool) -> list[Loss]:
        found = []
        for seed in range(count):
            found.append(fly_loss(noise, seed, dither))
            done()
        return found

    return Flights(
        seeds,
        run_exciting(min(seeds, MOST_EXCITING), exciting_manoeuvre(), done=done),
        variations(done),
        {noise: losses(noise, seeds, True) for noise in NOISES},
        {noise: losses(noise, 1 if noise == "none" else min(seeds, UNDITHERED), False) for noise in NOISES},
    )
