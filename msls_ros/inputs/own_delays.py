"""Delays of single surfaces that differ from those of the others, where the angular accelerations show them.

Each surface is shifted alone, the others fixed at the common delay, and its delay is where least is left unexplained;
again with the others at theirs, until none moves (coordinate search). One that differs from most others is named where

- on the axis that it explains most of, the residual sum of squares S falls so much that chance does not do it::

      (k / tau) log(S_common / S_own) > 30,        tau = 1 + 2 sum_l rho_l

  with k windows whose residuals have an autocorrelation rho (the ratio of likelihoods of normal variables);
- at the common delay it says nothing beside itself at its own (the J test of models that are not nested). What a law
  makes of gusts, or two surfaces that move together, fit better at another delay too, but then at both;
- it moves apart from states and other surfaces.

It is doubtful, not wrong: the limits were chosen on made-up flights. Of 24, .1 s of one surface was named in 36 of 48
checks, .05 s in 32 (nearly all in calm air; gusts hide it), and no right map in 486.

References
----------
Davidson and MacKinnon, "Several tests for model specification in the presence of alternative hypotheses", Econometrica
49 (1981). Bartlett, "On the theoretical specification and sampling properties of autocorrelated time-series", JRSS
Supplement 8 (1946).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation.kernel import Array
from msls_ros.inputs.response import Response, corrected
from msls_ros.inputs.windows import noise_of

_FARTHEST = 0.3
"""Delays beside the common one that are looked for [s]."""
_LEAST = 0.03
"""Difference from the others' delay that is named [s]."""
_ROUNDS = 4
"""Times that all surfaces are shifted, at most."""
_CHANCE = 30.0
"""Logarithm of the likelihoods' ratio, beyond chance among all the delays that are looked at."""
_PART, _EXPLAINED = 0.12, 0.02
"""Share of the residual, and of the angular accelerations of one axis, that a delay of its own must explain."""
_BOTH = 0.05
"""Share of what its own delay explains that the common one may explain beside it, of any axis."""
_LEFT = 0.2
"""Share of the angular accelerations of its axis that may be left beside noise: gusts that leave more hide it."""
_APART = 0.05
"""Share of a surface's motion that states and other surfaces do not make up, at least."""
_LIKE = 0.02
"""Difference up to which delays are the same [s]."""
_MEMORY = 1.0
"""Over which residuals are correlated, at most [s]."""
_SHARPER = 0.9
"""Share of what delays alone leave, below which the common lag of servos takes their place."""

Steps = NDArray[np.int64]


@dataclass(frozen=True)
class OwnDelay:
    """The delay of one surface that is not that of the others."""

    index: int
    """Of the surface."""
    steps: int
    """By which the aircraft answers it later than the map says; less than 0: earlier."""
    others: int
    """The same of the others."""


def own_delays(response: Response, common: int) -> list[OwnDelay]:
    """Return the surfaces whose delay is not that of the others.

    Parameters
    ----------
    response
        Rates, velocities and surfaces.
    common
        Best delay of all surfaces together, in steps.
    """
    if len(response.names) < 2:
        return []
    found, left = _Shifts(response).odd(common)
    if not found:
        return []
    servo = response.following(common)  # at one lag of all servos slow and quick surfaces seem to have other delays
    lagged = replace(response, delta=response.followed(servo.lag))
    other, remains = _Shifts(lagged).odd(round(servo.delay / response.step))
    return other if remains < _SHARPER * left else found


def shifted(response: Response, found: list[OwnDelay]) -> Response:
    """Return a response with these surfaces at the delay of the others."""
    by = np.zeros(len(response.names), dtype=np.int64)
    for one in found:
        by[one.index] = one.steps - one.others

    def moved(delta: Array) -> Array:
        at = np.arange(len(delta))[:, None] - by
        return np.asarray(np.take_along_axis(delta, np.clip(at, 0, len(delta) - 1), axis=0))

    before = response.followed
    return replace(response, delta=moved(response.delta), followed=lambda lag: moved(before(lag)))


class _Shifts:
    """The regression of a response with each surface at a delay of its own; m surfaces, k windows."""

    def __init__(self, response: Response) -> None:
        slope, states, held = response.means()
        self.step, self.count = response.step, held.shape[1]
        self.most = round((_FARTHEST + _LEAST) / self.step) + response.most
        inner = slice(self.most, len(slope) - self.most)
        self.y, self.states = _from_mean(slope[inner]), _from_mean(states[inner])
        self.held = held
        self.scale = np.maximum(np.square(self.y).sum(axis=0), 1e-300)
        ends = 2.0 * noise_of(response.turn) / (response.width * self.step) ** 2
        self.noise = len(self.y) * ends / self.scale
        noise = max(len(self.y), 1) * response.noise / (response.width * self.step)
        self.noise_states, self.noise_held = np.split(noise, [states.shape[1]])

    def column(self, index: int, steps: int) -> Array:
        """Return a surface (k, 1) of so many steps ago, from its mean."""
        column = self.held[self.most - steps : len(self.held) - self.most - steps, index : index + 1]
        return np.asarray(column - column.mean())

    def left(self, fixed: _Fixed, *columns: tuple[int, int]) -> Array:
        """Return the shares (axes,) that regressors leave with these surfaces (index, steps) beside them."""
        x = np.column_stack([self.column(i, s) for i, s in columns])
        return 1.0 - fixed.with_columns(x, self.noise_held[[i for i, _ in columns]])[1]

    def beside(self, index: int, delays: Steps) -> _Fixed:
        """Return the states and all surfaces but one, at their delays."""
        others = [j for j in range(self.count) if j != index]
        x = np.column_stack([self.states, *(self.column(j, int(delays[j])) for j in others)])
        return _Fixed(x, self.y, self.scale, np.concatenate([self.noise_states, self.noise_held[others]]))

    def odd(self, common: int) -> tuple[list[OwnDelay], float]:
        """Return the surfaces with other delays than most, and the share that is left with them."""
        if len(self.y) < 10 * self.most:
            return [], np.inf
        delays = np.full(self.count, common, dtype=np.int64)
        for _ in range(_ROUNDS):
            before = delays.copy()
            for index in range(self.count):
                delays[index] = self._best(index, delays, common)
            if np.array_equal(before, delays):
                break
        seen = np.array([self._seen(i, delays) for i in range(self.count)])
        others = self._usual(delays[seen]) if seen.any() else common
        delays = np.where(seen, delays, others)
        named = []
        for index in range(self.count):
            one = self._tested(index, delays, others, common)
            if one is not None:
                named.append(one)
        final = np.full(self.count, others, dtype=np.int64)
        for one in named:
            final[one.index] = one.steps
        return named, float(self.left(self.beside(0, final), (0, int(final[0]))).mean())

    def _range(self, common: int) -> range:
        most = round(_FARTHEST / self.step)
        return range(common - most, common + most + 1)

    def _best(self, index: int, delays: Steps, common: int) -> int:
        steps = self._range(common)
        columns = np.column_stack([self.column(index, s) for s in steps])
        left = self.beside(index, delays).left_by_each(columns, self.noise_held[index]).mean(axis=1)
        return min(zip(left.tolist(), (abs(s - common) for s in steps), steps, strict=True))[2]

    def _seen(self, index: int, delays: Steps) -> bool:
        """Whether a surface explains something that is not chance."""
        fixed = self.beside(index, delays)
        without, own = fixed.left, self.left(fixed, (index, int(delays[index])))
        axis = int(np.argmax(without - own))
        return self._evidence(fixed, (index, int(delays[index])), axis, float(without[axis])) > _CHANCE

    def _usual(self, delays: Steps) -> int:
        """Return the delay that most have; of as many, the one that the map says rather."""
        near = np.abs(delays[:, None] - delays) * self.step <= _LIKE
        best = max(range(len(delays)), key=lambda i: (int(near[i].sum()), -abs(int(delays[i]))))
        return int(np.median(delays[near[best]]))

    def _evidence(self, fixed: _Fixed, column: tuple[int, int], axis: int, before: float) -> float:
        """Return the logarithm of the likelihoods' ratio of what is left on an axis before, and with a column."""
        index, steps = column
        x = self.column(index, steps)
        weights, explained = fixed.with_columns(x, self.noise_held[[index]])
        residual = self.y[:, axis] - np.column_stack([fixed.x, x]) @ weights[:, axis]
        after = max(1.0 - float(explained[axis]), 1e-9)
        return len(residual) / _colour(residual, round(_MEMORY / self.step)) * float(np.log(max(before, after) / after))

    def _tested(self, index: int, delays: Steps, others: int, common: int) -> OwnDelay | None:
        steps = int(delays[index])
        if abs(steps - others) * self.step < max(_LEAST, 1.5 * self.step) - 1e-9:
            return None
        if steps in (self._range(common)[0], self._range(common)[-1]):
            return None
        fixed = self.beside(index, delays)
        usual, own = self.left(fixed, (index, others)), self.left(fixed, (index, steps))
        axis = int(np.argmax(usual - own))
        gain = float(usual[axis] - own[axis])
        if gain < max(_EXPLAINED, _PART * float(usual[axis])) or self._alone(index, fixed, steps) < _APART:
            return None
        both = self.left(fixed, (index, others), (index, steps))
        gusts = float(own[axis] - self.noise[axis])
        if gusts > _LEFT or float(np.max(own - both)) > _BOTH * float(usual[axis] - both[axis]):
            return None
        if self._evidence(fixed, (index, steps), axis, float(usual[axis])) < _CHANCE:
            return None
        return OwnDelay(index, steps, others)

    def _alone(self, index: int, fixed: _Fixed, steps: int) -> float:
        """Return the share of a surface's motion that states and other surfaces do not make up."""
        column = self.column(index, steps)
        weights, *_ = np.linalg.lstsq(fixed.x, column, rcond=None)
        return float(np.square(column - fixed.x @ weights).sum() / max(float(np.square(column).sum()), 1e-300))


class _Fixed:
    """Regressors that stay (k, p), with their products, beside which columns are tried."""

    def __init__(self, x: Array, y: Array, scale: Array, noise: Array) -> None:
        self.x, self.y, self.scale, self.noise = x, y, scale, noise
        self._gram, self._side = x.T @ x, x.T @ y

    @property
    def left(self) -> Array:
        """Shares (axes,) that they leave."""
        return 1.0 - self._solved(self._gram, self._side, self.noise)[1]

    def with_columns(self, columns: Array, noise: Array) -> tuple[Array, Array]:
        """Return the weights (p + c, axes) with columns (k, c) of these noises (c,), and the shares explained."""
        across = self.x.T @ columns
        gram = np.block([[self._gram, across], [across.T, columns.T @ columns]])
        side = np.concatenate([self._side, columns.T @ self.y])
        return self._solved(gram, side, np.concatenate([self.noise, noise]))

    def left_by_each(self, columns: Array, noise: float) -> Array:
        """Return the shares (c, axes) that are left with each of the columns (k, c) alone, of this noise."""
        p, count = len(self.noise), columns.shape[1]
        gram = np.empty((count, p + 1, p + 1))
        gram[:, :p, :p] = self._gram
        gram[:, p, :p] = gram[:, :p, p] = columns.T @ self.x
        gram[:, p, p] = np.square(columns).sum(axis=0)
        side = np.empty((count, p + 1, self.y.shape[1]))
        side[:, :p] = self._side
        side[:, p] = columns.T @ self.y
        return 1.0 - self._solved(gram, side, np.append(self.noise, noise))[1]

    def _solved(self, gram: Array, side: Array, noise: Array) -> tuple[Array, Array]:
        weights = np.linalg.pinv(corrected(gram, noise), rcond=1e-12, hermitian=True) @ side
        return weights, np.asarray((weights * side).sum(axis=-2) / self.scale)


def _from_mean(values: Array) -> Array:
    """Return columns (k, n) less their means; none of a log that is too short."""
    return np.asarray(values - values.mean(axis=0)) if len(values) else values


def _colour(residual: Array, lags: int) -> float:
    """Return by how much fewer independent values than residuals (k,) there are."""
    power = max(float(residual @ residual), 1e-300)
    total = 1.0
    for lag in range(1, min(lags, len(residual) - 1) + 1):
        share = float(residual[lag:] @ residual[:-lag]) / power
        if share <= 0.0:
            break
        total += 2.0 * share
    return total
