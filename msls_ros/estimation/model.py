"""Puts the linear model together: what physics knows, the estimates, their errors, and what to rely on (eq 24).

Row q of the regression holds the row of A and B of one state. In its place in the full matrices go the estimates, on
top of the known tangent of gravity and kinematics, and their standard errors. A parameter is reliable where the data
decide enough of it and its standard error is small for its size::

    rho >= excitation   and   error <= max( relative_error |theta|, tolerance / scale )

The bank has no rho. The size of an effect is there what it was when it was last known to a fifth, if that is more: that
an effector is dead is known when the error is small against what it did (`bank.uncertainty.observe_answers`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation.bank.attenuation import doubt
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.regression import BankRegression
from msls_ros.estimation.bank.rows import excitation_of
from msls_ros.estimation.bank.speed import power_of, published_value, seen_at, slope_by_speed
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.bank.uncertainty import bank_errors
from msls_ros.estimation.compiled import Bound, compiled, passed_by_reference
from msls_ros.estimation.configuration import Configuration
from msls_ros.estimation.engine import Engine
from msls_ros.estimation.errors import EstimationError
from msls_ros.estimation.kernel import Array, Integers
from msls_ros.estimation.kinematics import add_known, find_known, find_states
from msls_ros.estimation.reference import moving_air
from msls_ros.estimation.state import Settings, State
from msls_ros.estimation.uncertainty import error_bars

Flags = NDArray[np.bool_]


@passed_by_reference
class Model(NamedTuple):
    """``xdot = A x + B delta + bias`` with its errors; n states, m effectors, p regressors."""

    a: Array
    """(n, n)"""
    b: Array
    """(n, m)"""
    bias: Array
    """(n,)"""
    a_std: Array
    b_std: Array
    a_reliable: Flags
    b_reliable: Flags
    residual_std: Array
    """(n,) NaN where the equation is known."""
    excitation: Array
    """(p,) least over the rows."""


@passed_by_reference
class Best(NamedTuple):
    """The best that was known of a model; NaN where nothing is kept. n states, m effectors."""

    a_best: Array
    b_best: Array
    a_best_std: Array
    b_best_std: Array
    a_best_time: Array
    b_best_time: Array
    """[s]"""


@passed_by_reference
class BankScratch(NamedTuple):
    """Scratch of `fill_bank_model`; m members."""

    products: Array
    """(m,)"""
    bias: Array
    """(p,)"""
    errors: Array
    """(p,)"""
    phi: Array
    """(p,) regressors where the model is wanted."""


@passed_by_reference
class Layout(NamedTuple):
    """What `fill_model` needs to know; r rows."""

    kept: Integers
    """(r,) state of each row."""
    known: Integers
    """(9,) where the states of flight stand, see `find_states`; -1 where nothing is known."""
    turning: bool
    """Whether the turning of the body's axes is among what is known, see `kinematics`."""
    excitation: float
    """Least excitation of what is reliable [1]."""
    relative_error: float
    """Largest standard error of what is reliable, over its size [1]."""
    tolerance: Array
    """(p,) standard error that is small whatever the size, in units of each estimate."""


@compiled
def fill_model(
    settings: Settings, state: State, layout: Layout, x: Array, mix: Array, errors: Array, out: Model
) -> None:
    """Fill a model that holds nothing yet.

    Parameters
    ----------
    settings, state
        Of the loop.
    layout
        Sizes and limits.
    x
        (n,) states at which the known terms are linearised.
    mix, errors
        (2, colours) and (p,) scratch.
    out
        Zero; NaN, true or infinite where it shall stay so.
    """
    r = layout.kept.shape[0]
    last = errors.shape[0] - 1
    watched = state.samples[0] >= settings.watch or not settings.confounded or moving_air(state) == 0.0
    add_known(x, layout.known, layout.turning, out.a, out.bias)
    for q in range(r):
        row = layout.kept[q]
        out.residual_std[row] = error_bars(settings, state, q, mix[0], mix[1], errors)
        for i in range(last + 1):
            theta = state.theta[q, i]
            rho = state.rho[state.group[q], i]
            out.excitation[i] = min(out.excitation[i], rho)
            allowed = max(layout.relative_error * abs(theta), layout.tolerance[i])
            reliable = rho >= layout.excitation and errors[i] <= allowed and watched and state.misfits[q] == 0
            if i < r:
                column = layout.kept[i]
                out.a[row, column] += theta
                out.a_std[row, column] = errors[i]
                out.a_reliable[row, column] = reliable
            elif i < last:
                out.b[row, i - r] = theta
                out.b_std[row, i - r] = errors[i]
                out.b_reliable[row, i - r] = reliable
            else:
                out.bias[row] += theta


@compiled
def fill_bank_model(
    s: BankSettings,
    state: BankState,
    layout: Layout,
    x: Array,
    noise: Array,
    away: Array,
    scratch: BankScratch,
    out: Model,
    best: Best,
    forgetting: Array,
) -> None:
    """As `fill_model` for the bank: what is reliable is known well; ``out.excitation`` says what is excited now.

    Parameters
    ----------
    s, state
        Of the loop.
    layout
        Sizes and limits.
    x
        (n,) states at which the known terms are linearised.
    noise
        (r,) variance of the noise in the states, as regressors.
    away
        (r,) squares by which the states at ``x`` may be others.
    scratch
        See `BankScratch`.
    out, best
        Zero; NaN, true or infinite where it shall stay so.
    forgetting
        (n,) out, where an equation is identified.
    """
    r = layout.kept.shape[0]
    errors = scratch.errors
    last = errors.shape[0] - 1
    phi = scratch.phi
    add_known(x, layout.known, layout.turning, out.a, out.bias)
    ratio = seen_at(s, state, x, layout.kept, phi)
    for q in range(r):
        row = layout.kept[q]
        out.residual_std[row] = bank_errors(
            s, state, q, noise, away, phi, ratio, scratch.products, scratch.bias, errors
        )
        forgetting[row] = mean_forgetting(s, state, q)
        info = state.info[state.group[q]]
        for i in range(last + 1):
            j = (i + 1) % (last + 1)
            theta = published_value(s, state, q, phi, j, ratio)
            power = power_of(s, j, ratio)
            out.excitation[i] = min(out.excitation[i], excitation_of(s, info[j, s.recent], j))
            fixed = out.a[row, layout.kept[i]] if i < r else 0.0
            size = abs(theta + fixed) if not r <= i < last else max(abs(theta), power * state.effect[q, i - r])
            allowed = max(layout.relative_error * size, layout.tolerance[i])
            reliable = errors[i] <= allowed and state.misfits[q] == 0
            if i == last:
                out.bias[row] += theta
                continue
            known = state.best_square[q, j] < math.inf
            if i < r:
                column = layout.kept[i]
                out.a[row, column] += theta
                out.a_std[row, column] = errors[i]
                out.a_reliable[row, column] = reliable
                if known:
                    kept = state.best[q, j] + state.best_correction[q, j]
                    best.a_best[row, column] = theta + power * (kept - state.mixed[q, j] - state.shift[q, j]) + fixed
                    square = power * power * state.best_square[q, j]
                    slope = slope_by_speed(s, phi, j, ratio)
                    if slope != 0.0:
                        square += slope * slope * scratch.bias[0] * scratch.bias[0]
                    best.a_best_std[row, column] = math.sqrt(square)
                    best.a_best_time[row, column] = state.best_time[q, j]
            else:
                out.b[row, i - r] = theta
                out.b_std[row, i - r] = errors[i]
                out.b_reliable[row, i - r] = reliable
                if known:
                    best.b_best[row, i - r] = power * (state.best[q, j] + state.best_correction[q, j])
                    best.b_best_std[row, i - r] = power * math.sqrt(state.best_square[q, j] * doubt(s, state, j))
                    best.b_best_time[row, i - r] = state.best_time[q, j]


@compiled
def mean_forgetting(s: BankSettings, x: BankState, q: int) -> float:
    """Return the forgetting factor of row q: the members' mean, by their shares [1]."""
    total = 0.0
    for m in range(s.forgetting.shape[0]):
        total += x.weight[q, m] * s.forgetting[m]
    return total


class Assembly:
    """Builds the model of a regression.

    Parameters
    ----------
    configuration
        Names and limits of reliability.
    regression
        The engine.
    """

    def __init__(self, configuration: Configuration, regression: Engine) -> None:
        """Find the places of everything; see the class."""
        c = configuration
        n, p = len(c.states), len(c.regressors)
        kept = np.array([c.states.index(s) for s in c.rows], np.int64)
        self._shape = n, len(c.effectors), p
        self._regression = regression
        scale = np.array([c.reference_speed if s in ("u", "v", "w") else 1.0 for s in c.regressors])
        self._layout = Layout(
            kept=kept,
            known=find_states(c.states) if c.known_gravity else np.full(9, -1),
            turning=c.known_rotation,
            excitation=c.reliability.excitation,
            relative_error=c.reliability.relative_error,
            tolerance=c.reliability.tolerance / scale,
        )
        colours = 1 if isinstance(regression, BankRegression) else len(regression.settings.colours)
        self._scratch = np.empty((2, colours)), np.empty(p)
        members = len(regression.settings.forgetting) if isinstance(regression, BankRegression) else 0
        self._bank_scratch = BankScratch(np.empty(members), np.empty(p), np.empty(p), np.empty(p))
        self.a_known: Flags = find_known(c.states) if c.known_gravity else np.zeros((n, n), np.bool_)
        """(n, n) which entries of A come from physics; read-only."""
        self._forgetting = np.full(n, math.nan)
        if not isinstance(regression, BankRegression):
            self._forgetting[kept] = regression.settings.forgetting
        nothing = (np.full((n, columns), math.nan) for columns in (n, len(c.effectors)))
        self._fill = Bound(fill_bank_model if isinstance(regression, BankRegression) else fill_model)
        self._nothing = Best(*(tuple(nothing) * 3))
        for shared in (self.a_known, self._forgetting, *self._nothing):
            shared.setflags(write=False)

    def known_at(self, x: Array) -> tuple[Array, Array]:
        """Return what is known of A and bias from physics, linearised at ``x`` (n,): (n, n) and (n,)."""
        a, bias = np.zeros((len(x), len(x))), np.zeros(len(x))
        add_known(x, self._layout.known, self._layout.turning, a, bias)
        return a, bias

    def build(self, x: Array, seen: Array | None = None) -> tuple[Model, Best, Array]:
        """Return the model as it stands, its known part at ``x`` (n,); the best that was known; lambda per equation.

        Lambda is (n,) [1], NaN where the equation is known. What the estimator does not have is read-only. ``seen``
        (n,): the states as they were measured, if those are not believed yet; what is known of physics at ``x`` is off
        by the difference, as the bank's errors say.
        """
        n, m, p = self._shape
        model = Model(
            a=np.zeros((n, n)),
            b=np.zeros((n, m)),
            bias=np.zeros(n),
            a_std=np.zeros((n, n)),
            b_std=np.zeros((n, m)),
            a_reliable=self.a_known.copy(),
            b_reliable=np.empty((n, m), np.bool_),
            residual_std=np.empty(n),
            excitation=np.empty(p),
        )
        model.b_reliable.fill(True)
        model.residual_std.fill(math.nan)
        model.excitation.fill(math.inf)
        r = self._regression
        if not isinstance(r, BankRegression):
            self._fill(r.settings, r.state, self._layout, x, *self._scratch, model)
            return model, self._nothing, self._forgetting
        best = Best(*[one.copy() for one in self._nothing])
        forgetting = self._forgetting.copy()
        away = r.smoothed
        if seen is not None:
            away = away + (seen - x)[self._layout.kept] ** 2
        self._fill(r.settings, r.state, self._layout, x, r.noise, away, self._bank_scratch, model, best, forgetting)
        return model, best, forgetting

    def take_apart(
        self, a: Array, b: Array, bias: Array, x: Array | None, delta: Array | None
    ) -> tuple[Array, Array | None]:
        """Return of a model what is estimated, (r, p), less what physics knows, and the regressor there, (p,).

        Parameters
        ----------
        a, b, bias
            (n, n), (n, m) and (n,): ``xdot = a x + b delta + bias``. Known rows and columns are not read.
        x, delta
            (n,) and (m,) at which it stands; None: nothing that physics knows is in it; zero.

        Raises
        ------
        EstimationError
            For wrong shapes, or states and deflections that are not finite.
        """
        n, m, _ = self._shape
        a, b, bias = (np.asarray(v, dtype=np.float64) for v in (a, b, bias))
        if a.shape != (n, n) or b.shape != (n, m) or bias.shape != (n,):
            message = (
                f"a, b, bias of shapes {a.shape}, {b.shape}, {bias.shape}; expected ({n}, {n}), ({n}, {m}), ({n},)"
            )
            raise EstimationError(message)
        kept, seen = self._layout.kept, None
        if x is not None:
            x = np.ascontiguousarray(x, dtype=np.float64)
            moved = np.zeros(m) if delta is None else np.asarray(delta, dtype=np.float64)
            for name, array, length in (("states x", x, n), ("deflections delta", moved, m)):
                if array.shape != (length,) or not np.isfinite(array).all():
                    message = f"{name} of shape {array.shape}; expected ({length},), finite"
                    raise EstimationError(message)
            known_a, known_bias = self.known_at(x)
            a, bias = a - known_a, bias - known_bias
            seen = np.concatenate([x[kept], moved, [1.0]])
        theta: Array = np.concatenate([a[np.ix_(kept, kept)], b[kept], bias[kept, None]], axis=1)
        return theta, seen

    def take_errors(self, a_std: Array, b_std: Array) -> Array:
        """Return the standard errors of what is estimated, (r, p), of those of a model, (n, n) and (n, m).

        Raises
        ------
        EstimationError
            For wrong shapes.
        """
        n, m, p = self._shape
        a_std, b_std = (np.asarray(v, dtype=np.float64) for v in (a_std, b_std))
        if a_std.shape != (n, n) or b_std.shape != (n, m):
            message = f"errors of a, b of shapes {a_std.shape}, {b_std.shape}; expected ({n}, {n}), ({n}, {m})"
            raise EstimationError(message)
        kept = self._layout.kept
        errors: Array = np.full((len(kept), p), math.inf)
        errors[:, : p - 1] = np.concatenate([a_std[np.ix_(kept, kept)], b_std[kept]], axis=1)
        return errors
