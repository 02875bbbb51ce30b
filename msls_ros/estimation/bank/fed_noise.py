"""Deflections that follow the noise of a rate's sensor: what they and a slope of that rate have in common is no answer.

A damper moves its effector by the rate that is measured, noise and all. A slope that is made of the same rate in a
window (`msls_ros.inputs.derivatives`) holds that noise too, and least squares takes what both have in common for an
effect: an elevator that follows pitch rate by 40 ms, at rest, 100 Hz, is "Q -47.7 +- 9.7 by de" (-9.9 in truth).

An effect acts on the slope of its own time or of a later one. Noise of white n is in a slope with weights that are odd
about the middle of the window, and in what follows it later: what deflections have in common with the slope of then is
as large, and of the other sign, half a window to a window after the noise has come into them. With outputs y and
deviations u over seconds::

    C_l = sum y_k u_(k+l),      no answer where  C_0 (C_0 + 4 C_l) <= 0  or  |C_l| >= 2 |C_0|,      l = w/2 or w

w the samples of the window. What answers has its sign in all of them, or next to nothing in the later ones: dither is
white. Deflections that are recorded late have no more than twice as much in common later. Until an output has once
answered it, nothing is known of an effector (`bank.attenuation.doubt`). Derivatives that are measured have noise of
their own.

Rates differentiated, 100 Hz. 19 aircraft at rest for 20 s, four sequences of noise: in one of them 15 took that for an
answer, alarmed at their first elevator input, and named the elevator (C_w is -1.0 of C_0 there, .1 in dither); now
none. 30 made-up linear ones at rest with dampers of once and three times their own damping: 5 and 11, now none. With
`bank.effector_noise`'s answers in place of y, of which estimates have taken the noise: 1 and 6.

References
----------
Soderstrom and Stoica, *System Identification*, 1989, chapter 10 (feedback makes noise and input correlate).
"""

from __future__ import annotations

from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

OPPOSITE, TIMES = 4.0, 2.0
"""One over the share of what is in common now with which what is in common later may have the other sign; and so many
times as much it may be with the same.

Between what noise makes, as much with the other sign, and what answers, next to nothing (-1.0 and .1 above). With 2 for
4 a global5000 in gusts, which add what has the same sign, takes -.32 for an answer after 20 s, and names its elevator.
"""


@compiled
def observe_followers(s: BankSettings, x: BankState, q: int, phi: Array, y: float) -> None:
    """Update what row q's output y and the deflections in phi (p,), constant first, have in common, now and later."""
    size = x.past_outputs.shape[0]
    now = x.samples[0] % size
    whole, half = x.past_outputs[now, q], x.past_outputs[(now + size // 2) % size, q]
    x.past_outputs[now, q] = y
    for j in range(x.answered.shape[0]):
        if x.answered[j] != 0:
            continue
        i = s.effectors_from + 1 + j
        deviation = phi[i] - x.phi_mean[i]
        x.common[0, q, j] = s.mean_forgetting * x.common[0, q, j] + y * deviation
        x.common[1, q, j] = s.mean_forgetting * x.common[1, q, j] + half * deviation
        x.common[2, q, j] = s.mean_forgetting * x.common[2, q, j] + whole * deviation


@compiled
def follows_noise(s: BankSettings, x: BankState, q: int, j: int) -> bool:
    """Whether effector j and the output of row q have in common what may be noise that the effector follows."""
    if s.straddle == 0:
        return False
    now = x.common[0, q, j]
    for k in range(1, x.common.shape[0]):
        later = x.common[k, q, j]
        if now * (now + OPPOSITE * later) <= 0.0 or abs(later) >= TIMES * abs(now):
            return True
    return False
