"""How much of the angular accelerations states and surfaces explain, at which delay of the surfaces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation.kernel import Array
from msls_ros.inputs.windows import windowed

_WINDOW = 0.06
"""Over which the rates are differenced [s]."""
_LATEST = 0.25
"""Delays looked for in every step [s]."""
_FARTHEST, _SHARE, _COARSE = 3.0, 0.1, 0.05
"""Delays looked for at all [s], in a share of the record at most, and their steps [s]. Half a step off the delay of a
light aircraft .05 to .1 is left of what far delays leave."""
_PART = 0.7
"""Share of a regressor that is taken for noise, at most."""
_SEEN, _ALONE, _APART = 0.57, 1.15, 0.3
"""What surfaces leave at their delay, at most, over the median of all delays; where it is more, what delays further off
[s] leave over that, at least. Measured: .47 and 1.66 at most and at least in sound logs, with up to six times the noise
of a light aircraft's sensors; .68 and 1.07 at the best near delay of surfaces that are stamped 5 to 9 s late."""


_LAGS = (0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08, 0.1, 0.12, 0.15)
"""Time constants of servos that are looked for [s]."""
_RISEN = 0.02
"""Share by which what a delay leaves is beyond the least one: further off it goes on rising."""


class Following(NamedTuple):
    """A servo that follows the surfaces."""

    left: float
    """Share of the angular accelerations that is unexplained with it."""
    lag: float
    """Time constant [s]."""
    delay: float
    """By which it answers later than the map says; less than 0: earlier [s]."""


@dataclass(frozen=True)
class Search:
    """What surfaces leave unexplained at delays up to `_FARTHEST`; l of them."""

    step: float
    """Of the delays counted in steps [s]."""
    delays: NDArray[np.int64]
    """(l,) in steps."""
    left: Array
    """(l,) share of the angular accelerations."""

    @property
    def farthest(self) -> float:
        """The largest delay [s]."""
        return float(np.abs(self.delays).max()) * self.step

    @property
    def typical(self) -> float:
        """The share that the median delay leaves."""
        return float(np.median(self.left))

    def shows(self, left: float, lag: float) -> bool:
        """Whether a share that is left at a delay [s] stands out from those of the others."""
        if left <= _SEEN * self.typical:
            return True
        others = self.left[np.abs(self.delays * self.step - lag) > _APART]
        return len(others) > 0 and float(others.min()) > _ALONE * left

    def beyond(self, response: Response, near: float, *, at_end: bool) -> int | None:
        """Return a delay beyond `_LATEST` in steps, where one stands out and none of those nearer does.

        Parameters
        ----------
        response
            Searched.
        near
            The least share that one of the nearer leaves.
        at_end
            Whether that is the largest of them: they may go on.
        """
        outside = np.abs(self.delays) > response.most
        if not outside.any() or not (at_end or near > _SEEN * self.typical):
            return None
        best = int(self.delays[outside][np.argmin(self.left[outside])])
        around = range(best - round(_COARSE / self.step), best + round(_COARSE / self.step) + 1)
        fine = {steps: response.left_at(steps) for steps in around if abs(steps) <= response.farthest}
        steps = min(fine, key=lambda one: fine[one])
        plain = fine[steps] < min(near, _SEEN * self.typical) and abs(steps) > response.most
        return steps if plain else None


@dataclass(frozen=True)
class Response:
    """Rates, velocities and surfaces at common instants; k of them.

    Over a window ``slope of rates = A mean of states + B mean of surfaces``, without an error of discretisation. All
    states are needed: damping and a law that feeds rates back make of rates and surfaces alone a delay that is none. A
    noise in the states makes A smaller and a delay of the rest; its part in the products of the means is taken off.
    """

    step: float
    """[s]"""
    names: list[str]
    """Of the surfaces."""
    turn: Array
    """(k, 1 to 3) rates, FRD."""
    moves: list[Array]
    """(k, c) of each stream of velocity; none where they are not mapped."""
    delta: Array
    """(k, m)"""
    noise: Array
    """Variance of the noise of a sample of each column of the three, times its period [s]."""
    followed: Callable[[float], Array]
    """Returns ``delta`` (k, m) as servos of a time constant [s] follow it."""

    def means(self) -> tuple[Array, Array, Array]:
        """Return the slopes (l, .), and the means of the states (l, .) and of the surfaces (l, m)."""
        width = self.width
        slope = (self.turn[width:] - self.turn[:-width]) / (width * self.step)
        return slope, windowed(np.column_stack([self.turn, *self.moves]), width), windowed(self.delta, width)

    @property
    def width(self) -> int:
        """Steps of a window."""
        return max(2, round(_WINDOW / self.step))

    @property
    def most(self) -> int:
        """Steps of the largest delay that is looked for in every step."""
        return max(1, round(_LATEST / self.step))

    @property
    def farthest(self) -> int:
        """Steps of the largest delay that is looked for."""
        return max(self.most, round(min(_FARTHEST / self.step, _SHARE * len(self.turn))))

    def left_at(self, steps: int) -> float:
        """Return the share of the angular accelerations that surfaces of so many steps ago leave unexplained."""
        return self._left(*self.means(), steps, self.farthest)

    def search(self) -> Search:
        """Return what is left at delays up to the farthest, in coarse steps."""
        means, one = self.means(), max(1, round(_COARSE / self.step))
        count = self.farthest // one
        delays = one * np.arange(-count, count + 1)
        left = np.array([self._left(*means, int(steps), self.farthest) for steps in delays])
        return Search(self.step, delays, left)

    def scores(self) -> Array:
        """Return the share of the angular accelerations that is left unexplained, by delay, from the most negative."""
        slope, states, held = self.means()
        most = self.most
        return np.array([self._left(slope, states, held, steps, most) for steps in range(-most, most + 1)])

    def following(self, steps: int) -> Following:
        """Return the servo in place of a delay of so many steps that leaves least; its delay may be less than none.

        A delay is as good as the servo's own and a part of its lag: more of it, the slower the surfaces move.
        """
        slope, states, _ = self.means()
        found = []
        for lag in _LAGS:
            behind = windowed(self.followed(lag), self.width)
            best = Following(np.inf, lag, 0.0)
            for own in range(steps, max(steps - round(lag / self.step) - 2, -self.most - 1), -1):
                one = Following(self._left(slope, states, behind, own, self.most), lag, own * self.step)
                if one.left > best.left + _RISEN:
                    break
                best = min(best, one)
            found.append(best)
        return min(found)

    def _left(self, slope: Array, states: Array, held: Array, steps: int, most: int) -> float:
        """Return the share of the slopes that surfaces of so many steps ago leave, but for so many at both ends."""
        inner = slice(most, len(slope) - most)
        y = slope[inner] - slope[inner].mean(axis=0)
        x = np.column_stack([states[inner], held[most - steps : len(held) - most - steps]])
        x -= x.mean(axis=0)
        gram, side = x.T @ x, x.T @ y  # one pass over the samples; the residual needs no better conditioning
        known = len(x) * self.noise / (self.width * self.step)
        weights = np.linalg.pinv(corrected(gram, known), rcond=1e-12, hermitian=True) @ side
        scale = np.maximum(np.square(y).sum(axis=0), 1e-300)
        return float(np.mean(1.0 - (weights * side).sum(axis=0) / scale))

    def effects(self, steps: int) -> tuple[Array, Array]:
        """Return what each surface turns the aircraft by, rms (m, 3) [rad/s^2], and the rms of what is left (3,)."""
        slope, states, held = self.means()
        most = self.most
        own = held[most - steps : len(held) - most - steps]
        x = np.column_stack([own, states[most : len(slope) - most], np.ones(len(own))])
        y = slope[most : len(slope) - most]
        weights, *_ = np.linalg.lstsq(x, y, rcond=None)
        return np.abs(weights[: own.shape[1]]) * own.std(axis=0)[:, None], np.asarray((y - x @ weights).std(axis=0))


def corrected(gram: Array, noise: Array) -> Array:
    """Return the products of regressors less those of their noise, as much of it as leaves them positive definite.

    Parameters
    ----------
    gram
        (..., p, p) products.
    noise
        (p,) of each regressor.

    Returns
    -------
    ndarray
        (..., p, p)
    """
    size = np.sqrt(np.maximum(np.diagonal(gram, axis1=-2, axis2=-1), 1e-300))
    scale = size[..., :, None] * size[..., None, :]
    one, part = gram / scale, np.sqrt(noise) / size
    inverse = np.linalg.pinv(one, rcond=1e-12, hermitian=True)
    most = np.linalg.eigvalsh(part[..., :, None] * inverse * part[..., None, :])[..., -1]
    share = np.where(most > _PART, _PART / np.maximum(most, 1e-300), 1.0)
    return np.asarray((one - share[..., None, None] * (part * part)[..., None] * np.eye(len(noise))) * scale)
