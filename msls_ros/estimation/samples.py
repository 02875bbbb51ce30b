"""Samples as the compiled loop takes them: checked, and with the regression that is built of them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from msls_ros.estimation.arguments import DIFFERENTIATED, as_numbers
from msls_ros.estimation.bank.regression import BankRegression
from msls_ros.estimation.configuration import Configuration
from msls_ros.estimation.engine import Engine
from msls_ros.estimation.errors import EstimationError
from msls_ros.estimation.kernel import Array
from msls_ros.estimation.kinematics import build_regression, find_forces, find_states
from msls_ros.estimation.regressor_noise import clear_defect, make_defect, make_noise, observe_defect
from msls_ros.estimation.screening import Screened
from msls_ros.estimation.soundness import all_within
from msls_ros.estimation.state import Output
from msls_ros.estimation.state_filter import clear_filter, filter_states, make_filter

LARGEST = 1e12
"""Numbers of this size and more are refused: their squares would drown all that the estimator knows."""


class Samples(NamedTuple):
    """Samples to learn from, as the compiled loop takes them: k of n states, m effectors, p regressors, r rows."""

    time: Array
    """(k,) [s]."""
    x: Array
    xdot: Array
    delta: Array
    """(k, n), (k, n), (k, m)."""
    phi: Array
    y: Array
    """(k, p) and (k, r): what is regressed on what; not filled where nothing is learnt."""
    out: Output
    """What the loop says of them."""


class Preparation:
    """Builds the regression of samples, one block after the other.

    Parameters
    ----------
    configuration
        Names, and the rate of the samples that are learnt from.
    engine
        That learns from them.
    """

    def __init__(self, configuration: Configuration, engine: Engine) -> None:
        """Find the places of everything; see the class."""
        c = configuration
        self._engine = engine
        self._kept = np.array([c.states.index(s) for s in c.rows], np.int64)
        self._regressors = len(c.regressors)
        self._number = len(c.states)
        self._forces = find_forces(c.rows, c.known_gravity)
        self._states = find_states(c.states)
        self._turning = c.known_rotation
        self._defect = make_defect(c.rows, len(c.effectors), c.sample_rate)
        self._filter = make_filter(self._defect.size, self._defect.delay.velocity)
        self._filters = isinstance(engine, BankRegression) and engine.settings.straddle == 0

    def reset(self) -> None:
        """Forget the samples before."""
        clear_defect(self._defect)
        clear_filter(self._filter)

    @property
    def state_delay(self) -> Array:
        """(n,) by how much the states come after their derivatives, for certain [s]."""
        found = np.zeros(self._number)
        found[self._kept] = self._defect.delay.late
        return found

    def prepare(self, screened: Screened, learnt: bool) -> Samples:
        """Build the regression of samples, where they are learnt from, and room for what comes of them."""
        time, x, xdot, delta = screened[:4]
        count = len(time)
        phi, y = np.empty((count, self._regressors)), np.empty((count, len(self._kept)))
        if learnt and count > 0:
            regressed = x
            if isinstance(self._engine, BankRegression):
                noise, regressed = make_noise(count, len(self._kept)), x.copy()
                observe_defect(self._defect, time, x, xdot, delta, self._kept, noise, regressed)
                self._engine.observe(time, noise)
            build_regression(regressed, xdot, delta, self._kept, self._forces, self._states, self._turning, phi, y)
            if self._filters:
                filter_states(self._filter, time, regressed, xdot, self._kept, noise, phi)
        return Samples(time, x, xdot, delta, phi, y, self._engine.make_output(count))


def check_samples(c: Configuration, count: int, x: Array, xdot: Array, delta: Array) -> None:
    """Raise EstimationError for samples of wrong shapes, or that hold numbers that are not finite or too large."""
    derivatives = tuple(f"d{s}/dt" for s in c.states)
    for name, array, columns in (("x", x, c.states), ("xdot", xdot, derivatives), ("delta", delta, c.effectors)):
        if array.shape != (count, len(columns)):
            message = f"{name} has shape {array.shape}; expected ({count}, {len(columns)})"
            raise EstimationError(message)
        if not all_within(array, LARGEST):
            k, i = np.argwhere(~(np.abs(array) < LARGEST))[0]
            message = f"{name} holds a number that is not finite or too large: {columns[i]} is {array[k, i]:g} at "
            message += f"sample {k}; expected less than {LARGEST:g} in size: "
            missing = name == "xdot" and bool(np.isnan(array[:, i]).all())
            message += DIFFERENTIATED if missing else "leave such samples out"
            raise EstimationError(message)


def as_block(name: str, sample: Any) -> Array:
    """Return one sample, (n,), as a block of one, (1, n)."""
    return as_numbers(name, sample).reshape(1, -1)
