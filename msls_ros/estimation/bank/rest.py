"""Whether an effector rests: what moves of it in the record is noise of its sensor, or is answered, as dither is.

The memory of seconds of `bank.answers` is full of answers when an effector comes to rest, and for so long its noise
passes for motion that has lost its effect. So in short blocks in which all that moves is white (no more than third
differences hold) it is asked whether what was known of the effect answers::

    ln(p(none)/p(theta)) = sum (1/2 a^2 P + a C) / (s^2 spread),     a = -c_0 theta

with the block's sums C = C_0 and P of the squares w^2 of `bank.answers`, over the rows whose effect is known.
Where it adds up to a hundred to one that nothing answers, the block is all that is remembered, and what moves is noise.
The total loss of an effector that dithers looks the same; but there white motion as large has been answered before.
What has been decided holds until the other is (`unanswered_noise`).

Through windows the prediction error e is held against what is quick of the deflection itself, u: third differences hold
little of it there. With S of its squares, of which noise makes no more than ``N = n sigma^2``, the same is ::

    ln(p(none)/p(theta)) = -sum theta (N/S) (1/2 theta N + sum e u) / (s^2 spread)

with the block's own mean of e^2 for s^2 where it is larger than the residual's (members follow smoothed noise), and the
spread of a sum of products of values that have passed the window (Bartlett). Known is what has been known best, for
noise of the deflection is in the errors of now.
"""

from __future__ import annotations

from msls_ros.estimation.bank.answers import ANSWERED
from msls_ros.estimation.bank.effector_noise import most_noise
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled

CALM = 2.0
"""Mean square of what is quick of a deflection, over the variance by third differences, up to which all of it is white.

An effector that moves has 10 to 100, dither behind an actuator of 20 rad/s 1 to 8 (A-4, 50 Hz).
"""
ALIKE = 4.0
"""By which factor white motion may differ in square from what was answered before, and count as the same."""
KNOWN = 25.0
"""Squared standard errors by which an effect must differ from none, to be missed: as `bank.losses.KNOWN_WELL`."""
DECIDED = 4.5
"""Logarithm of the likelihood ratio that decides whether an effector rests: a hundred to one.

Made-up linear aircraft as measured (as `benchmark linear`), seeds 4030 to 4119 at 25 Hz, without and with: false alarms
8 -> 2, names 34 right both, wrong 4 -> 0; 3000 to 3119 13 -> 7, 47 -> 49, 1 both; 2000 to 2119 11 -> 10, 38 -> 41, 3 ->
0. Half ailerons of an A-4 that only dither shows, medium noise: 20 of 20 seen both ways; 18 where what has once been
taken for noise stays so, though it is answered later; without noise 12 where a half of an answer may be none.
"""


@compiled
def observe_rest(s: BankSettings, x: BankState) -> None:
    """Ask of each effector, once in `BankSettings.rest_block` samples, whether it rests; see the module."""
    block = x.samples[0] // s.rest_block
    if block == x.rest[0]:
        return
    x.rest[0] = block
    for j in range(x.whites.shape[1]):
        judge_rest(s, x, j)
        x.rest_energy[j] = 0.0
        for q in range(x.rest_cross.shape[0]):
            x.rest_cross[q, j, :] = 0.0
            x.rest_power[q, j] = 0.0
            x.rest_square[q, j] = 0.0


@compiled
def judge_rest(s: BankSettings, x: BankState, j: int) -> None:
    """Add up the evidence that nothing answers the white motion of effector j, and that it is answered; act on it."""
    now = most_noise(s, x, j)
    if x.rest_energy[j] > CALM * s.rest_block * now:
        x.rest_evidence[:, j] = 0.0
        return
    evidence = evidence_of_rest(s, x, j)
    rested = x.rest_evidence[0, j] >= DECIDED
    x.rest_evidence[0, j] = min(max(x.rest_evidence[0, j] + evidence, 0.0), DECIDED)
    x.rest_evidence[1, j] = min(x.rest_evidence[1, j] + evidence, 0.0)
    if x.rest_evidence[1, j] < -DECIDED:
        x.dithered[j] = now
        x.rest_evidence[:, j] = 0.0
        x.third_floor[j] = 0.0
        x.rested[j] = 0.0
    elif x.rest_evidence[0, j] >= DECIDED and not was_answered(s, x, j):
        x.third_floor[j] = now
        x.rested[j] = now
        if not rested:
            forget_answers(s, x, j)


@compiled
def forget_answers(s: BankSettings, x: BankState, j: int) -> None:
    """Remember of what outputs answered effector j the present block only; through windows, that it was nothing."""
    for q in range(x.rest_cross.shape[0]):
        if s.straddle > 0:
            x.white_cross[q, j, :] = 0.0
        else:
            x.white_power[q, j] = x.rest_power[q, j]
            for m in range(x.white_cross.shape[2]):
                x.white_cross[q, j, m] = x.rest_cross[q, j, m]


@compiled
def was_answered(s: BankSettings, x: BankState, j: int) -> bool:
    """Whether white motion of effector j as large as that of now has been answered before: then it is dither."""
    now, dithered = most_noise(s, x, j), x.dithered[j]
    return bool(now < ALIKE * dithered and dithered < ALIKE * now)


@compiled
def evidence_of_rest(s: BankSettings, x: BankState, j: int) -> float:
    """Log likelihood ratio of no answer to effector j's white motion in the present block, over the known effect's."""
    i = s.effectors_from + 1 + j
    evidence = 0.0
    for q in range(x.rest_cross.shape[0]):
        effect = x.mixed[q, i]
        if x.kept[0] == 0 or x.residual[q, 0] <= 0.0 or (s.straddle > 0 and s.differenced[q] == 0):
            continue
        known = x.best_square[q, i]
        if s.straddle == 0:
            known = x.kept_square[(x.kept[0] - 1) % x.kept_square.shape[0], q, i]
        if KNOWN * known <= effect * effect:
            evidence += evidence_of_row(s, x, q, j, effect)
    return evidence


@compiled
def evidence_of_row(s: BankSettings, x: BankState, q: int, j: int, effect: float) -> float:
    """Evidence by row q, of which effector j has a known effect."""
    power, residual = x.rest_power[q, j], x.residual[q, 0] / x.residual[q, 1]
    if s.straddle > 0:
        cross = x.rest_cross[q, j, 0]
        variance = s.rest_spread * max(residual, x.rest_square[q, j] / s.rest_block)
        answer = effect * min(1.0, s.rest_block * most_noise(s, x, j) / power) if power > 0.0 else 0.0
        one = -(0.5 * answer * answer * power + answer * cross) / variance
    else:
        cross = x.rest_cross[q, j, s.late]
        variance = s.white_spread * x.residual[q, 0] / x.residual[q, 1]
        answer = -x.white_parts[s.kind[q], s.late] * effect
        one = (0.5 * answer * answer * power + answer * cross) / variance
    return float(one if cross * cross < ANSWERED * variance * power else min(one, 0.0))


@compiled
def unanswered_noise(s: BankSettings, x: BankState, j: int) -> float:
    """Variance of what is noise in effector j, a hundred to one: it has rested since it last was dither."""
    return 0.0 if was_answered(s, x, j) else float(min(x.rested[j], most_noise(s, x, j)))
