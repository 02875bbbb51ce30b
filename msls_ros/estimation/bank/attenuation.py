"""What noise in the regressors does to estimates and to what is known of them.

Least squares takes regressors for exact. With the noise ``sigma_k^2`` of regressor k, and V the inverse of the
information of n samples, estimates are off by (Fuller)::

    b_j = - sum_k n sigma_k^2 V_jk theta_k

which is counted as a sum of squares: how noisy each regressor is is not known well enough for them to cancel. What
`kinematics` takes off an output belongs to ``theta_k`` here as far as its noise is in the output, which is measured
(`entering_part`). And of the information about coefficient j, which is that of what the others leave of its regressor,
the share ::

    lambda_j = sum_k n sigma_k^2 V_jk^2 / V_jj

is noise: of its own sensor, and of those that it follows, as a rudder does that answers the yaw rate. The prior of the
member is no motion either. The estimate is ``1 - lambda`` of the effect in the mean. So the bias is
``lambda / (1 - lambda)`` times an estimate that has an error of its own::

    se_j^2 (1 + (lambda / (1 - lambda))^2) + (b_j / (1 - lambda))^2 / 5

How noisy the states are says `regressor_noise`, the deflections `bank.effector_noise`, as far as noise is white. An
effector that rests is all noise of some colour: no output answers it, so that its effect seems nothing and certain,
while nothing has been learnt. Until an output has once answered it beyond 5 standard errors, all that was seen of it
counts for noise, and its effects are known to nobody (`doubt`).

References
----------
Fuller, *Measurement Error Models*, 1987, sections 1.1 (reliability ratio) and 2.2.
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.effector_noise import entering_part, state_noise
from msls_ros.estimation.bank.gusts import noise_part
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.speed import power_of, ratio_of
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

ATTENUATED = 0.2
"""Share of the squared bias by noise in the states that counts.

With .5, 95 % of the errors were within .4 to 1.1 of a bar that this dominates (seed 811, all beds); now .7 to 1.8.
"""
LEARNT = 0.5
"""Largest share of what is known of a coefficient that may be its prior, for anything to be said of it [1].

The widths of priors are in standard deviations of the residual. Without noise, in trim, that is next to none, and so is
the error of what no data have parted: of a transport aircraft (52 t, 25 Hz, not one of ours, seeds 11 to 14) A was
covered in .14 before its first input and in .77 in the seconds after it, median |z| 870; with this nothing is called
reliable before it, and .93 after. With noise little changes (`calibration`, seeds 851 and 852: shares by .01 at most).
"""
NOTICED = 1e-3
"""Share of the information about a coefficient from which noise in its regressor is looked at [1]."""
LEAST = 0.01
"""Least share of the information that is taken for motion: the error is at most a hundred times as large."""


@compiled
def attenuation(s: BankSettings, x: BankState, q: int, m: int, noise: Array, b: Array) -> None:
    """Squared bias of row q's estimates by noise in the regressors, and ``x.widened``: the share that is noise.

    Parameters
    ----------
    s, x
        Settings and state; where there is noise, ``x.columns`` is filled in.
    q, m
        Row, and the member that leads there.
    noise
        (r,) variance of the noise in the states, that are the first regressors.
    b
        (p,) out, constant first.
    """
    p = b.shape[0]
    g = x.group[q]
    share = x.widened[q]
    for i in range(p):
        b[i] = 0.0
        share[i] = 0.0
    solved = False
    for n in range(1, p):
        variance = noise_in(s, x, g, n, m, noise)
        if variance <= NOTICED * x.info[g, n, m]:
            continue
        variance = noise_of_row(s, x, q, n, m, variance)
        if variance <= NOTICED * x.info[g, n, m]:
            continue
        if not solved:
            invert(x.R[g], m, x.columns)
            solved = True
        w = x.columns[n]
        turned = turned_part(s, x, q, n, m)
        if turned != 0.0:
            turned = entering_part(s, x, q, n, turned)
        amount = variance * (x.mixed[q, n] + turned)
        for j in range(p):
            share[j] += variance * w[j] * w[j] * x.info[g, j, m]
            b[j] += amount * amount * w[j] * w[j]


@compiled
def noise_in(s: BankSettings, x: BankState, g: int, n: int, m: int, noise: Array) -> float:
    """Return ``n sigma^2`` of regressor n in what member m of group g remembers; noise as in `attenuation`.

    That of a state is as it showed when it came (`BankState.noisy`), and no less than if all of it had that of now.
    """
    if n <= noise.shape[0]:
        return float(max(x.taken[g, m] * state_noise(s, x, n - 1, noise[n - 1]), x.noisy[g, n - 1, m]))
    if s.effectors_from < n <= s.effectors_to:
        return float(x.taken[g, m] * x.third_noise[n - s.effectors_from - 1])
    return 0.0


@compiled
def noise_of_row(s: BankSettings, x: BankState, q: int, n: int, m: int, variance: float) -> float:
    """Return as much of ``variance``, `noise_in` regressor n, as is noise to row q: gusts are none (`bank.gusts`).

    Of what is found with gusts and all `ATTENUATED` of the squared bias counts, of what is left without them all of it.
    """
    if n > s.effectors_from:
        return variance
    g, number = x.group[q], x.taken[x.group[q], m]
    white = min(max(x.noisy_white[g, n - 1, m], number * x.white_noise[n - 1]), variance)
    part = noise_part(s, x, q, n - 1, (variance - white) / max(number, 1.0))
    return float(white + min(part / math.sqrt(ATTENUATED), 1.0) * (variance - white))


@compiled
def turned_part(s: BankSettings, x: BankState, q: int, i: int, m: int) -> float:
    """Return the part of row q's derivative by regressor i that is known, on average over what member m remembers."""
    source = s.turning[q + 1, i]
    if source == 0:
        return 0.0
    ratio = ratio_of(x)
    return float(
        s.turned[q + 1, i] * x.centre[x.group[q], source, m] / (power_of(s, source, ratio) * power_of(s, i, ratio))
    )


@compiled
def invert(R: Array, m: int, inverse: Array) -> None:
    """Fill in ``(R'R)^-1`` of member m: (p, p, m), (p, p) out, column n in row n.

    All columns at once, so that the inner loops wait for no sum.
    """
    p = inverse.shape[0]
    for j in range(p):
        row = inverse[j]
        for n in range(p):
            row[n] = 1.0 if j == n else 0.0
        for k in range(j):
            take_times(row, inverse[k], R[k, j, m], k + 1)
        divide(row, R[j, j, m], j + 1)
    for j in range(p - 1, -1, -1):
        row = inverse[j]
        for k in range(j + 1, p):
            take_times(row, inverse[k], R[j, k, m], p)
        divide(row, R[j, j, m], p)
    for j in range(p):
        for n in range(j):
            inverse[j, n], inverse[n, j] = inverse[n, j], inverse[j, n]


@compiled
def take_times(row: Array, other: Array, factor: float, number: int) -> None:
    """``row -= factor other``, so many of them."""
    for n in range(number):
        row[n] -= factor * other[n]


@compiled
def divide(row: Array, by: float, number: int) -> None:
    """``row /= by``, so many of them."""
    for n in range(number):
        row[n] /= by


@compiled
def most_noise_share(x: BankState, g: int, m: int, noise: float) -> float:
    """Share of information that is noise, ``noise``, and a standard error of its variance over so many samples [1]."""
    return float(noise * (1.0 + math.sqrt(2.0 / max(x.taken[g, m], 1.0))))


@compiled
def prior_share(s: BankSettings, x: BankState, g: int, i: int, m: int) -> float:
    """Share of the information about coefficient i that is the prior of member m [1].

    What an effector has taken back after a name (`bank.restoring`) was learnt from motion.
    """
    prior = s.prior[i, m] * s.prior[i, m]
    if i <= s.effectors_from:
        prior += x.kept_info[g, i]
    return float(prior / x.info[g, i, m])


@compiled
def widened_by(hidden: float) -> float:
    """By how much errors are larger, squared, where that share of the information is no motion; `LEAST` is left."""
    motion = max(1.0 - hidden, LEAST)
    off = (1.0 - motion) / motion
    return off * off


@compiled
def doubt(s: BankSettings, x: BankState, i: int) -> float:
    """By how much the squared errors about an effector are larger while no output has answered it; 1 otherwise [1]."""
    resting = s.effectors_from < i <= s.effectors_to and x.answered[i - s.effectors_from - 1] == 0
    return 1.0 / (LEAST * LEAST) if resting else 1.0


@compiled
def widen(s: BankSettings, x: BankState, q: int, m: int, bias: Array, squares: Array) -> None:
    """Widen row q's squared errors (p,) by what `attenuation` found; ``bias`` (p,) becomes what they hold of it."""
    g = x.group[q]
    x.widened[q, 0] = 1.0
    bias[0] *= ATTENUATED
    squares[0] += bias[0]
    for i in range(1, bias.shape[0]):
        noise, prior = most_noise_share(x, g, m, x.widened[q, i]), prior_share(s, x, g, i, m)
        motion = max(1.0 - noise - prior, LEAST)
        x.widened[q, i] = 1.0 + widened_by(noise + prior)
        x.unlearnt[q, i] = widened_by(noise) + min(prior, 1.0)
        bias[i] *= ATTENUATED / (motion * motion)
        squares[i] = squares[i] * x.widened[q, i] + bias[i]
