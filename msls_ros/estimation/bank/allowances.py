"""What a prediction error may be without a change: by standard errors, rounding and times of deflections.

See `bank.detection`, which holds errors against it.
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.attenuation import LEAST, doubt
from msls_ros.estimation.bank.delay import deflection_of
from msls_ros.estimation.bank.effector_noise import rounding_noise
from msls_ros.estimation.bank.energy import FIRST
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.bank.together import ANEW, KNOWN
from msls_ros.estimation.bank.uncertainty import HIDDEN, common_square
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

BY_NOISE = 9.0
"""Squared standard deviations of the noise in a deflection beyond which it is motion."""
NOISE_ALONE = 2.0
"""`BankState.widened` of a coefficient of whose information half is noise."""
FURTHER = 4.0
"""Squared deviation over the energy remembered from which a regressor goes further than usual."""


@compiled
def take_motion(s: BankSettings, x: BankState, phi: Array) -> None:
    """Fill in ``x.moving`` (2, p): what effectors move now beyond noise, and how far phi (p,) is from their means."""
    for i in range(s.effectors_from + 1, s.effectors_to + 1):
        moves = x.quick[i] * x.quick[i] > noise_limit(s, x, i)
        x.moving[0, i] = x.quick[i] if moves else 0.0
        x.moving[1, i] = phi[i] - x.phi_mean[i]


@compiled
def observe_states(s: BankSettings, x: BankState) -> None:
    """Fill in ``x.state_motion`` (4, p): how far states move beyond noise now, squared, and the most of it before.

    In the stretch that runs, in the last one, and in all before: stretches are as long as what is new is learnt.
    """
    turn = x.samples[0] % s.learning == 0
    motion = x.state_motion
    for i in range(1, s.effectors_from + 1):
        moved = x.quick_mean[i] - x.slow_mean[i]
        beyond = moved * moved - BY_NOISE * x.white_noise[i - 1] * s.quick / (2.0 - s.quick)
        if turn:
            motion[3, i] = max(motion[2, i], motion[3, i])
            motion[2, i] = motion[1, i]
            motion[1, i] = 0.0
        motion[0, i] = max(beyond, 0.0)
        motion[1, i] = max(motion[0, i], motion[1, i])


@compiled
def find_shapes(s: BankSettings, x: BankState, g: int, axis: int, row: Array) -> None:
    """Find ``x.shapes`` (2, axes): the error of what `take_motion` found together, over that of each by itself."""
    m = s.reference[axis]
    for k in range(2):
        alone = 0.0
        for i in range(s.effectors_from + 1, s.effectors_to + 1):
            alone += x.moving[k, i] * x.moving[k, i] / x.info[g, i, m]
        together = uncertainty_of(x.R[g], m, x.moving[k], row) if alone > 0.0 else 0.0
        x.shapes[k, axis] = min(together / alone, 1.0) if alone > 0.0 else 1.0


@compiled
def uncertainty_of(R: Array, m: int, phi: Array, w: Array) -> float:
    """Return ``d = phi' (R'R)^-1 phi`` of member m by substitution, ``R' w = phi``; (p, p, m), (p,), scratch (p,)."""
    d = 0.0
    for j in range(phi.shape[0]):
        total = phi[j]
        for k in range(j):
            total -= R[k, j, m] * w[k]
        w[j] = total / R[j, j, m]
        d += w[j] * w[j]
    return d


@compiled
def unknown_square(s: BankSettings, x: BankState, q: int, phi: Array) -> float:
    """Squared error that row q may have because regressors go further than those that its estimates are known by."""
    total = hidden_square(s, x, q)
    for i in range(1, phi.shape[0]):
        deviation = phi[i] - x.phi_mean[i]
        if deviation * deviation > max(FURTHER * x.phi_remembered[i], noise_limit(s, x, i)):
            shape = x.shapes[1, s.row_axis[q]] if s.effectors_from < i <= s.effectors_to else 1.0
            total += shape * deviation * deviation * x.square_moved[q, i] * doubt(s, x, i)
    return total


@compiled
def hidden_square(s: BankSettings, x: BankState, q: int) -> float:
    """Squared error that row q may have because a state moves whose effect noise has hidden until now.

    An angle of attack that was all noise seems to have no effect, and certainly none; with the first doublet it does
    what it does. What moves is the mean of a tenth of a second against that of half a second, beyond what noise makes
    of it; of what `bank.attenuation.widen` adds to the squared error `HIDDEN` times that counts at most, and no more
    than the usual squared error: what noise has hidden stands out of it by little at first, a loss by ten times.
    Deflections need no such thing: their noise does not hide them from the first input on.

    A V-tail of 14 kg (50 Hz, not one of ours, .2 m/s of noise in velocities, 57 flights): 6 false alarms as measured,
    10 with rates differentiated, nearly all at the first input of an axis, without this; 0 and 3 with it, and 26 and
    23 of 32 losses are seen. Six other aircraft (216 flights, seeds 1 and 2): 8 false alarms, 83 losses are seen; 3 and
    81 if it excused in all flight, which hides stabilators of the F-16. Half ailerons in flight test (seeds 851 and
    852): 23 of 24 within half a second, without the usual error as a limit 15 to 17.
    """
    total = 0.0
    for i in range(1, s.effectors_from + 1):
        beyond = x.state_motion[0, i]
        if beyond > FURTHER * x.state_motion[3, i]:
            total += beyond * x.square_hidden[q, i]
    usual = x.base[q, 2] / x.base[q, 1] if x.base[q, 1] > 0.0 else 0.0
    return float(min(total, usual))


@compiled
def moved_square(s: BankSettings, x: BankState, q: int) -> float:
    """Squared error that row q's standard errors allow the motion since they were made (`BankState.quick`)."""
    total = 0.0
    for i in range(1, x.quick.shape[0]):
        now = x.quick[i] * x.quick[i]
        if now > noise_limit(s, x, i) or x.together[0] != KNOWN:
            square = x.square_moved[q, i] if x.together[0] == KNOWN else open_square(s, x, q, i)
            if now > first_limit(s, x, i, FIRST) or x.together[0] == ANEW:
                square *= doubt(s, x, i)
            if x.alert[0] > 0:
                square = min(square, x.square_past[1, q, i])
            if s.effectors_from < i <= s.effectors_to:
                shares = min(common_square(x, q, i), square)
                square = shares + x.shapes[0, s.row_axis[q]] * (square - shares)
            total += now * square
    return total


@compiled
def open_square(s: BankSettings, x: BankState, q: int, i: int) -> float:
    """Return `BankState.square_moved` of an effector with all that noise in the regressors makes wider.

    Where that is most of what has taught its effect nothing is known of it, for the noise is not known so well.
    """
    square = x.square_moved[q, i]
    if not s.effectors_from < i <= s.effectors_to or square == math.inf:
        return float(square)
    if x.widened[q, i] > NOISE_ALONE:
        return float(square / (LEAST * LEAST))
    counted = min(x.widened[q, i], HIDDEN) if s.straddle == 0 else 1.0
    return float(min(square * max(x.widened[q, i] / counted, 1.0), max(x.carried[q, i], square)))


@compiled
def noise_limit(s: BankSettings, x: BankState, i: int) -> float:
    """Square that the noise in the deflections hardly ever makes of regressor i (constant first); 0 for states."""
    if not s.effectors_from < i <= s.effectors_to:
        return 0.0
    return float(BY_NOISE * x.third_noise[i - s.effectors_from - 1])


@compiled
def first_limit(s: BankSettings, x: BankState, i: int, share: float) -> float:
    """Square from which a deflection goes further than in the last seconds: ``share`` of their mean square.

    Against the noise alone one that a law has hardly moved yet would hide losses of others: half ailerons held in
    flight test through windows, seed 851: 10 of 12 are seen, 4 with five standard deviations of the noise.
    """
    if not s.effectors_from < i <= s.effectors_to or x.quick_samples[0] <= 0.0:
        return math.inf
    return float(share * x.moment[i, i] / x.quick_samples[0])


@compiled
def rounding_square(s: BankSettings, x: BankState, q: int) -> float:
    """Squared error that row q may have by the rounding of the recorded deflections."""
    total = 0.0
    for j in range(x.quantum.shape[1]):
        effect = x.mixed[q, s.effectors_from + 1 + j]
        total += effect * effect * rounding_noise(s, x, j)
    return total


@compiled
def timing_square(s: BankSettings, x: BankState, q: int) -> float:
    """Squared error that row q may have because it is not known when between two samples a deflection moved.

    Of a step at any time of a sample that acts a part p of one late, all or nothing has acted, and p of it is reckoned
    with: ``p (1-p)`` of its square, and as much more as p is not known. What a short memory has learnt from it shows in
    the sample after it. Windows smooth steps.
    """
    if s.straddle > 0:
        return 0.0
    slot = x.samples[0] % x.recent.shape[0]
    whole = int(x.delay[s.kind[q], 0])
    part = x.delay[s.kind[q], 0] - whole
    share = part * (1.0 - part) + min(x.delay[s.kind[q], 1] * s.late * s.late, 0.25)
    total = 0.0
    for j in range(x.recent.shape[1]):
        i = s.effectors_from + 1 + j
        step = deflection_of(s, x, slot - whole, 0.0, j) - deflection_of(s, x, slot - whole, 1.0, j)
        if step * step > noise_limit(s, x, i):
            total += x.mixed[q, i] * x.mixed[q, i] * step * step * share
    return total
