"""How far the estimates move while they should not: variance by batch means.

The variance of least squares is that of the residual over the information only where the residual has nothing to do
with the regressors. Model errors have: they are the same in every turn. What no autocorrelation of the residual shows,
the estimates do: each manoeuvre moves them by more than their standard error. A batch that adds ``I - I_old`` to the
information and moves an estimate by D differs from all data by ``D I_old/(I - I_old)``, and its weight is
``(I - I_old)/I``. So the sum over the batches of what each is off by, weighted and squared, is::

    S <- (kept I_old / I)^2 (S + D^2)

with the share of the older information that is not forgotten. It is what the variance is at least. Batches are of 1, 4
and 16 s: they must be longer than what correlates them, and shorter than the flight. The largest S counts, that of few
batches by Student's t (`BankSettings.batch_factor`).

References
----------
White, "A heteroskedasticity-consistent covariance matrix estimator", Econometrica 48 (1980). Newey and West,
Econometrica 55 (1987). Law and Kelton, *Simulation Modeling and Analysis*, section 9.5.3 (batch means).
"""

from __future__ import annotations

from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled


@compiled
def observe_batches(s: BankSettings, x: BankState, q: int, leader: int, samples: int) -> None:
    """Update what row q's estimates have moved by, batch by batch, ``samples`` after the last call."""
    g = x.group[q]
    loss = (1.0 - s.forgetting[leader]) * (1.0 - s.held[leader] * (1.0 - x.axis_gate[g, s.axis[leader]]))
    for k in range(s.batches.shape[0]):
        x.batch_kept[k, q] *= max(1.0 - loss * samples, 0.0)
        number = x.samples[0] // s.batches[k]
        if number == x.batch_number[k, q]:
            continue
        x.batch_number[k, q] = number
        for i in range(x.mixed.shape[1]):
            batch = x.batch[k, q, i]
            step = x.mixed[q, i] - batch[1]
            share = min(x.batch_kept[k, q] * batch[2] / x.known[q, i], 1.0)
            batch[0] = share * share * (batch[0] + step * step)
            batch[1] = x.mixed[q, i]
            batch[2] = x.known[q, i]
        x.batch_kept[k, q] = 1.0


@compiled
def batch_square(s: BankSettings, x: BankState, q: int, i: int) -> float:
    """Variance of row q's coefficient i by what it has moved, by the batches that say most."""
    largest = 0.0
    for k in range(x.batch.shape[0]):
        largest = max(largest, s.batch_factor[k] * x.batch[k, q, i, 0])
    return float(largest)


@compiled
def clear_batches(x: BankState, q: int) -> None:
    """Forget what row q's estimates have moved by."""
    for k in range(x.batch.shape[0]):
        for i in range(x.batch.shape[2]):
            for n in range(3):
                x.batch[k, q, i, n] = 0.0


@compiled
def shift_batches(x: BankState, q: int, i: int, step: float) -> None:
    """Let no batch hold that a loss, which is applied, has moved row q's coefficient i by this step."""
    for k in range(x.batch.shape[0]):
        x.batch[k, q, i, 1] += step
