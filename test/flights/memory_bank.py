"""Mixtures of least squares with many memories, as first published with the beds: not the bank of `estimation`.

Members differ in forgetting factor, width of the prior and drift of the constant, and are mixed by how well they
predict: one step ahead, or with coefficients of three samples ago. The first follows every smooth motion and knows
nothing, which is what the beds have to show. Information form, all rows and members at once.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

SCALE = 0.01
"""Of the regressors [rad, rad/s, 1]."""
CONSTANT_WIDTH, PENALTY, EVIDENCE_MEMORY = 1000.0, 0.1, 0.99
WIDEST = 1e5
"""Prior of the members that keep what they know at a weak alarm."""
WINDOWS = {1: 32.8, 3: 13.3, 8: 6.97, 20: 4.25}
"""Of the detector [samples], and what a mean square over each may be over its base by chance."""
LONGEST, BASE_MEMORY, THRESHOLD, STRONG = 20, 200.0, 1.5, 4.5


@dataclass(frozen=True)
class Grid:
    """Members are all combinations; ``delay`` [samples], ``power`` of the evidence, ``floor`` of the detector."""

    forgetting: tuple[float, ...]
    widths: tuple[float, ...]
    drifts: tuple[float, ...]
    floor: float
    delay: int = 0
    power: float = 1.0


ONE_STEP = Grid((0.8, 0.93, 0.98, 0.997), (10.0, 300.0, WIDEST), (0.1, 1.0, 10.0), 0.05)
DELAYED = Grid(
    tuple(math.exp(-0.04 / memory) for memory in (0.1, 0.4, 1.5, 6.0, 30.0)),
    (30.0, WIDEST),
    (0.0, 0.1, 1.0, 10.0),
    0.1,
    3,
    0.3,
)
"""At 25 Hz; weighted by the precision of each coefficient too."""


class Detector:
    """Mean squared prediction errors of each row over short windows, against those before them."""

    def __init__(self, rows: int, silence: int, floor: float) -> None:
        self._silence, self._floor = silence, floor
        self._base, self._weight, self._outputs = np.zeros(rows), np.zeros(rows), np.zeros(rows)
        self._recent: list[list[float]] = [[] for _ in range(rows)]
        self._since = np.full(rows, -LONGEST)

    def update(self, k: int, y: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Return the statistics (r,); an alarm is one above `THRESHOLD`."""
        self._outputs += (y**2 - self._outputs) / min(k + 1, 500)
        found = np.zeros(len(y))
        for q, square in enumerate((error**2).tolist()):
            recent = self._recent[q]
            if self._weight[q] >= LONGEST and self._since[q] >= LONGEST:
                base = self._base[q] / self._weight[q] + self._floor**2 * self._outputs[q]
                last = [*recent[len(recent) - LONGEST + 1 :], square]
                found[q] = max(sum(last[-n:]) / n / base / chance for n, chance in WINDOWS.items())
            if self._since[q] >= 0 and found[q] > THRESHOLD:
                self._since[q] = -self._silence
                continue
            if self._since[q] >= 0:
                if self._since[q] >= LONGEST:
                    kept = 1.0 - 1.0 / BASE_MEMORY
                    self._base[q] = kept * self._base[q] + recent[-LONGEST]
                    self._weight[q] = kept * self._weight[q] + 1.0
                recent.append(square)
            self._since[q] += 1
        return found


class MemoryBank:
    """Mixed coefficients ``theta`` (r, p) of regressors (p,), the constant last."""

    def __init__(self, grid: Grid, rows: int, p: int) -> None:
        self._grid = grid
        members = np.array(list(itertools.product(grid.forgetting, grid.widths, grid.drifts)))
        self._forgetting, widths, self._drifts2 = members[:, 0], members[:, 1], members[:, 2] ** 2
        roots = np.repeat((SCALE / widths)[:, None], p, axis=1)
        roots[:, -1] = 1.0 / np.maximum(widths, CONSTANT_WIDTH)
        self._prior = roots[:, :, None] ** 2 * np.eye(p)
        self._penalty = PENALTY**2 * roots**2 * (p * (1.0 - self._forgetting))[:, None]
        self._widest = widths == WIDEST
        m = len(members)
        self._information = np.tile(self._prior, (rows, 1, 1, 1))
        self._members = np.zeros((rows, m, p))
        self._past = [self._members.copy() for _ in range(max(grid.delay, 1))]
        self._samples = 0
        self._age, self._count = np.zeros(rows, np.int64), np.zeros(rows)
        self._squares, self._late, self._spread = np.zeros((rows, m)), np.zeros((rows, m)), np.zeros((rows, m))
        self._detector = Detector(rows, 2 * p, grid.floor)
        self.theta = self._predicting = np.zeros((rows, p))

    def update(self, phi: np.ndarray, y: np.ndarray) -> None:
        """Take a sample: regressors (p,) and outputs (r,)."""
        grid, rows, k = self._grid, np.arange(len(y)), self._samples
        self._samples += 1
        statistic = self._detector.update(k, y, y - self._predicting @ phi)
        for q in np.flatnonzero(statistic > THRESHOLD):
            self._restart(int(q), bool(statistic[q] > STRONG))
        self._forget(k)
        m, p = self._members.shape[1:]
        if grid.delay:
            covariance = np.linalg.inv(self._information)
            gain = covariance @ phi
        else:
            gain = np.linalg.solve(self._information, np.broadcast_to(phi[:, None], (len(y), m, p, 1)))[..., 0]
        excess = 1.0 + gain @ phi
        error = y[:, None] - self._members @ phi
        back = np.minimum(grid.delay, np.maximum(1, self._age // 2))
        old = np.array([self._past[-b][q] for q, b in zip(rows, back, strict=True)]) if grid.delay else self._members
        late = y[:, None] - old @ phi
        self._members = self._members + error[..., None] * gain / excess[..., None]
        self._information = self._information + np.outer(phi, phi)
        self._past = [*self._past[1:], self._members]
        self._count = EVIDENCE_MEMORY * self._count + 1.0
        self._squares = EVIDENCE_MEMORY * self._squares + error**2 / excess
        self._late = EVIDENCE_MEMORY * self._late + late**2 / excess
        self._spread = EVIDENCE_MEMORY * self._spread + np.log(excess)
        self._age += 1
        one_step, delayed = (self._weights(squares) for squares in (self._squares, self._late))
        self._predicting = (one_step[..., None] * self._members).sum(axis=1)
        if not grid.delay:
            self.theta = self._predicting
            return
        variances = np.diagonal(covariance, axis1=2, axis2=3) - gain**2 / excess[..., None]
        weights = delayed[..., None] ** grid.power / variances
        self.theta = (weights * self._members).sum(axis=1) / weights.sum(axis=1)

    def _forget(self, k: int) -> None:
        """Before each sample of a row but its first."""
        used = self._age > 0
        information = self._information[used] * self._forgetting[:, None, None]
        row = information[:, :, -1]
        shrunk = self._drifts2 / (1.0 + self._drifts2 * row[..., -1])
        information = information - shrunk[..., None, None] * row[..., :, None] * row[..., None, :]
        i = k % row.shape[-1]
        information[:, :, i, i] += self._penalty[:, i]
        self._information[used] = information

    def _weights(self, squares: np.ndarray) -> np.ndarray:
        evidence = -0.5 * (self._count[:, None] * np.log(squares + 1e-300) + self._spread)
        weights = np.exp(evidence - evidence.max(axis=1, keepdims=True))
        found: np.ndarray = weights / weights.sum(axis=1, keepdims=True)
        return found

    def _restart(self, q: int, strong: bool) -> None:
        gone = ~self._widest if self._grid.delay and not strong else np.ones(len(self._widest), np.bool_)
        self._information[q, gone] = self._prior[gone]
        self._age[q], self._count[q] = 0, 0.0
        self._squares[q] = self._late[q] = self._spread[q] = 0.0
        self._members = self._members.copy()
        for one in (self._members, *self._past):
            one[q, gone] = self.theta[q]
