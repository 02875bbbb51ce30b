"""Deflections that follow the noise of a rate's sensor: what they and a slope of that rate have in common is no answer.

A damper moves its effector by the rate that is measured, noise and all. A slope that is made of the same rate in a
window (`msls_ros.inputs.derivatives`) holds that noise too, and least squares takes what both have in common for an
effect: an elevator that follows pitch rate by 40 ms, at rest, 100 Hz, is "Q -47.7 +- 9.7 by de" (-9.9 in truth).

An effect acts on the slope of its own time. Noise of white n is in a slope with weights that are odd about the middle
of the window, and in what follows it later: where deflections are behind by up to a window, what they have in common
with the slope changes sign when the deflections of a window later are taken. With answers a, what the output does by
the effector and beyond the model (`bank_effector_noise.observe_answer`), and deviations u over seconds::

    C_now = sum a_k u_k,      C_later = sum a_k u_(k+w),      no answer where  C_now (C_now + 2 C_later) <= 0

w the samples of the window. What answers has its sign in both, or next to nothing in the latter: dither is white.
Until an output has once answered it, nothing is known of an effector (`bank_attenuation.doubt`).

Of 19 aircraft at rest for 20 s, rates differentiated, 100 Hz, in one of four sequences of noise 15 took that for an
answer, alarmed at their first elevator input, and named the elevator (C_later is -1.0 of C_now there; .1 in dither).
Derivatives that are measured have noise of their own.

References
----------
Soderstrom and Stoica, *System Identification*, 1989, chapter 10 (feedback makes noise and input correlate).
"""

from __future__ import annotations

from msls_ros.estimation.bank_state import BankSettings, BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

OPPOSITE = 2.0
"""One over the share of what is in common now with which what is in common later may have the other sign."""


@compiled
def observe_followers(s: BankSettings, x: BankState, q: int, phi: Array) -> None:
    """Update what row q's output and the deflections in phi (p,), constant first, have in common, now and later."""
    slot = x.samples[0] % x.past_answers.shape[0]
    for j in range(x.answered.shape[0]):
        if x.answered[j] != 0:
            continue
        i = s.effectors_from + 1 + j
        deviation = phi[i] - x.phi_mean[i]
        then = x.past_answers[slot, q, j]
        x.past_answers[slot, q, j] = x.white_answer[q, j]
        x.common[0, q, j] = s.mean_forgetting * x.common[0, q, j] + x.white_answer[q, j] * deviation
        x.common[1, q, j] = s.mean_forgetting * x.common[1, q, j] + then * deviation


@compiled
def follows_noise(s: BankSettings, x: BankState, q: int, j: int) -> bool:
    """Whether effector j and the output of row q have in common what may be noise that the effector follows."""
    now, later = x.common[0, q, j], x.common[1, q, j]
    return s.straddle > 0 and now * (now + OPPOSITE * later) <= 0.0
