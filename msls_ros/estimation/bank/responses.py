"""Actuators between the deflections that are recorded and those that act: their lag and longer delays, found in flight.

Logs of small aircraft hold the commands to the servos, not what these make of them: 15 to 30 ms later, and through a
lag of 30 to 70 ms. Least squares then finds a quarter of the effect of an aileron, and is sure of it, for where a
control law closes the loop the command also follows from the answer. A delay alone does not mend that (half of it is
found), the lag has to be in the regressor. So a few responses are held against each other side by side, each of which
takes the commands through no lag or one (`bank.settings.LAGS`), and back by whole steps of l samples
(`BankSettings.late`, `bank.settings.BACKS`)::

    tau df/dt = command - f,      h_j = f_j(k - n l),   u_j = f_j(k - (n+1) l) - h_j

exactly for commands that are straight between samples (held ones seem half a sample later). The quick outputs (above
their mean of the last tenth of a second) are regressed on the quick states and ``g_j = h_j + d u_j``, by steps of Gauss
and Newton for the d that all rows have in common, 0 to 1, as in `bank.delay`. All are means of l samples. With the sums
over the last seconds the profile likelihood of response a is, over the rows::

    L_a = -1/2 sum_q (n_q / c_q) ln( left_q(a) ),         c_q corrects for autocorrelation

where rows count of which the effectors explain at least half of what the states leave, and its evidence is ``L_a -
L_now``, summed over half a minute of excited flight. A lag also averages the noise of measured deflections, which fits
better whatever is late; so a lag must also be better than the same filter without its delay, ``f_j(k + tau)``, which is
looked at in the past. Deflections and commands may also be recorded late (a slow bus, a filter of their sensor): n may
be -1, and -2 without a lag, and once that is taken states and outputs are held back by as much (`hold`). With a lag
that is next to its filter without a delay, so there it suffices that more is gained than averaging can make: with the
variance sigma^2 of the noise, ``-1/2 sum_q (n_q / c_q) ln(1 - sum_j theta_j^2 n sigma_j^2 / (l left_q))``. (For all
lags that suffices not: of a servo of 7 rad/s in noise a third of the lag was found.) Two samples of which each counts
in part hold less noise than one: what comes before is in the states as well, what comes after is not, so it is the
record that seems late. Where no lag is between them, an early response must gain more than that, ``2 d (1 - d)`` of the
noise (`averaged_share`). And a state that is noisy is less than it is to least squares; deflections that a law moves
with it, slowly, say more of it than its own record, late and through a lag most of all. Of a state with a share rho of
noise in what the other regressors leave of it, its effect theta as it is found, that may be ``theta^2 n sigma^2 / (1 -
rho)`` of what is left at most (Fuller, errors in variables), which a longer delay or a lag must gain besides
(`find_hidden`). Noise in a row's own state makes it seem early too (`seems_early`); such rows do not count there. And
what deflections have made of such a state before is in their lag, more clearly than in its record: with the contrary
sign of their effect, for it damps. A lag that turns effects round gains nothing (`turns_round`). What is white in an
output, by its third differences, is the noise of its sensor and none of what effectors should explain.

A response other than that of now is taken when its evidence is decisive (`DECISIVE`); all that has been learnt belongs
to other regressors then, and every equation begins anew, as after an alarm. What is left of the delay, a fraction of l,
is found by `bank.delay`, with deflections that have passed the response. Effects are those of the deflections that act.
Until it is decided, what speaks for another response is in the bars (``response_doubt``): the share by which effects
would be others with it, or by which deflections are off as they move (`RISE`), no more than its evidence over the
decisive one. Afterwards `UNSHAPED` or `LAGLESS` is: a lag that is found is not the whole shape, a long delay without
one is half of it, which gusts hide, and a short one may be a lag, or what is wrong with a servo that was declared
(`shape_doubt`).

References
----------
Kass and Raftery, "Bayes factors", J. Am. Stat. Assoc. 90 (1995) (decisive evidence). Klein and Morelli, *Aircraft
System Identification*, 2006, section 10.2 (actuators, time delays). Fuller, *Measurement Error Models*, 1987, section
1.1 (attenuation).
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.answers import MEDIAN, median_of
from msls_ros.estimation.bank.effector_noise import most_noise, state_noise, third_difference
from msls_ros.estimation.bank.lags import APART, MOMENTS, REDUNDANT, factorise, solve_backward, solve_forward
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.residual import autocorrelation
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.elementary import logarithm
from msls_ros.estimation.kernel import Array

DECISIVE = 15.0
"""Evidence from which on another response is taken [1]: e^15 to one.

A pilot who answers gusts feigns a late response: with 10 an A-4 in gusts took one before its first input, and raised
two false alarms by it (seed 851). Made-up linear aircraft as measured, seeds 4200 on, 60, recorded as drawn, late, to
slow servos, with 10 and with 15: false alarms 1, 17, 0 and 1, 17, 2, names right 21, 23, 21 and 22, 23, 22, wrong 0, 3,
0 and 0, 2, 0.
"""
AGAIN = 25.0
"""The same once a response has been taken: all begins anew with each, and the last one is not far off [1]."""
ANSWERS = 0.5
"""Least share of what the states leave of a row's quick output that effectors explain, for the row to count [1].

Where a pilot or a law answers gusts a lag explains more, whatever there is: an A-4 in gusts, before its first input, is
explained to .1 to .2 by its effectors, to .3 to .45 through a lag; small aircraft, flown by servo commands, to .73 to
.97.
"""
FORGOTTEN = 0.1
"""Memory of the sums over that of the evidence: responses do not change in flight [1]."""
UNSHAPED = 0.25
"""Relative error of estimates by what is not known of an actuator, once a lag is taken into account [1].

Servos of 20 and 15 rad/s behind 20 and 30 ms (`benchmark calibration --servos`, seeds 2 and 3): what is called reliable
of the main effects is .55 to .7 of the truth at worst, by lags of 35 and 60 ms.
"""
LAGLESS = 0.33
"""The same where all that is found of it is a delay: in gusts, closed loop, it stands in for a lag as well [1].

There P by the aileron is .45 to .65 of the truth (seeds 4 and 5); with .25 B was covered in .69 to .88 behind servos,
with .33 in .91 to .94, with .4 in .94 to .97.
"""
LEAST_LEFT = 0.1
"""Least share of what is left that is not the white noise of sensors [1]."""
TINY = 1e-300
"""Least median square of third differences."""
RISE = 0.025
"""Time in which a deflection moves [s]: what it is off by where it is late is such a share of its motion."""
QUICK, SLOW = 0.01, 0.02
"""Delays between which what may be wrong with a servo that was declared begins to count [s]; see `shape_doubt`."""
LAG = 0.03
"""A delay of that may all be a lag, of which `LAGLESS` of an effect is lost; of less than `QUICK` none is [s].

A lag of ``tau`` takes ``(w tau)^2/2`` of an effect at w, 25 rad/s here; deflections are quick above 6 to 10 rad/s.
"""
RECORDS = 0.025
"""Delays of more than that are not those of records alone, see `bank.settings.DELAY_OF_RECORDS` [s]."""
ACTUATORS = 0.04
"""From that on it is an actuator's in any case: that is where another response is taken [s]."""
LOOK = 64
"""Responses are compared after every so many blocks of l samples, of whose means all sums are."""
PASSES = 2
"""Most steps of Gauss and Newton at a look; another one where the last was cut short."""
STEP = 0.5
"""Largest one, of d [1]."""
BEYOND = 0.25
"""By how much d may lie outside of 0 to 1: what is at the edge is left to the response that is taken.

Nor is one taken that is earlier by less than that. Windows make slopes of rates differ from their derivatives by a
little, which without noise is significant and looks early: of 128 flights of a twin and three small aircraft (not ours;
intact or with losses, deflections measured in time) 21 took a record for one sample late, with this 7, as measured in
much noise; 120 made-up aircraft with late records (`linear --record late`) have the same alarms and names.
"""


@compiled
def respond(s: BankSettings, x: BankState, phi: Array, y: Array, factor: Array, w: Array, z: Array, to: Array) -> bool:
    """Put the deflections that act into the regressor; return whether another response is taken from now on.

    Parameters
    ----------
    s, x
        Settings and state before the sample.
    phi, y
        (p,) regressor, constant first, its effectors replaced, its states too where they are held; (r,) outputs.
    factor, w, z
        (p, p), (p,) and (p,) scratch.
    to
        (r,) out: the outputs that go with this regressor.
    """
    for q in range(y.shape[0]):
        to[q] = y[q]
    count = x.lagged.shape[1]
    if count == 0:
        return False
    send(s, x, phi, y)
    taken = False
    k = x.samples[0]
    if (k + 1) % s.late == 0:
        observe_block(s, x, (k + 1) // s.late - 1)
        if (k + 1) // s.late % LOOK == 0:
            taken = compare_responses(s, x, factor, w, z)
    now = x.response[0]
    first = s.effectors_from + 1
    held = held_back(s, x)
    slot = (k - min(s.responses[now, 1] * s.late + held, k)) % x.sent.shape[1]
    for j in range(count):
        phi[first + j] = x.sent[s.responses[now, 0], slot, j]
    hold(x, phi, to, min(held, k))
    return taken


@compiled
def least_part(s: BankSettings, a: int) -> float:
    """Return the least d of response a: from the deflections themselves none, for `bank.delay` takes them back only."""
    return 0.0 if s.responses[a, 1] == 0 else -BEYOND


@compiled
def held_back(s: BankSettings, x: BankState) -> int:
    """Return by how many samples states and outputs are held back, for deflections that are recorded late."""
    return int(max(-s.responses[x.response[0], 1], 0) * s.late)


@compiled
def hold(x: BankState, phi: Array, y: Array, back: int) -> None:
    """Put states and outputs of ``back`` samples ago in the place of those of now: (p,) constant first, (r,)."""
    size, states = x.held.shape[0], x.held.shape[1] - y.shape[0]
    now, then = x.samples[0] % size, (x.samples[0] - back) % size
    for i in range(states):
        x.held[now, i] = phi[i + 1]
        phi[i + 1] = x.held[then, i]
    for q in range(y.shape[0]):
        x.held[now, states + q] = y[q]
        y[q] = x.held[then, states + q]


@compiled
def send(s: BankSettings, x: BankState, phi: Array, y: Array) -> None:
    """Take the commands through the lags, and add up all signals over the block of l samples."""
    k = x.samples[0]
    first = s.effectors_from + 1
    count = x.lagged.shape[1]
    size = x.sent.shape[1]
    part = 1.0 / s.late
    fresh = k % s.late == 0
    for j in range(count):
        command = phi[first + j]
        before = x.sent[0, (k - 1) % size, j] if k > 0 else command
        for t in range(x.lagged.shape[0]):
            old = x.lagged[t, j] if k > 0 else command
            x.lagged[t, j] = s.lags[t, 0] * old + s.lags[t, 1] * before + s.lags[t, 2] * command
            x.sent[t, k % size, j] = x.lagged[t, j]
            x.block_sent[t, j] = (0.0 if fresh else x.block_sent[t, j]) + part * x.lagged[t, j]
    states = s.effectors_from
    for i in range(states):
        x.block[i] = (0.0 if fresh else x.block[i]) + part * phi[i + 1]
    for q in range(y.shape[0]):
        x.block[states + q] = (0.0 if fresh else x.block[states + q]) + part * y[q]
        third = third_difference(s, x, x.output_past[:, q], y[q])
        x.output_median[q] = median_of(x.output_median[q], third, TINY, k - x.output_past.shape[0])


@compiled
def observe_block(s: BankSettings, x: BankState, number: int) -> None:
    """Update the sums of all responses with the means of a block; ``number`` of it, from 0 on."""
    count = x.lagged.shape[1]
    size = x.sent_quick.shape[1]
    start = max(1.0 / (number + 1.0), s.block_quick)
    slot = number % size
    for t in range(x.lagged.shape[0]):
        for j in range(count):
            x.sent_mean[t, j] += start * (x.block_sent[t, j] - x.sent_mean[t, j])
            x.sent_quick[t, slot, j] = x.block_sent[t, j] - x.sent_mean[t, j]
    for i in range(x.block.shape[0]):
        x.response_mean[i] += start * (x.block[i] - x.response_mean[i])
        x.response_past[slot, i] = x.block[i] - x.response_mean[i]
    then = x.response_past[(number - min(s.ahead, number)) % size]
    fade = s.block_forgetting
    x.response_samples[0] = fade * x.response_samples[0] + 1.0
    x.response_block[0] = number
    for i in range(then.shape[0]):
        add_times(x.response_sums[i], then, then[i], fade, i + 1)
    for a in range(s.pairs.shape[0]):
        moved = x.sent_quick[s.pairs[a, 0], (number - min(s.pairs[a, 1], number)) % size]
        for j in range(count):
            add_times(x.sent_sums[a, j], then, moved[j], fade, then.shape[0])
    before = (number - 1) % size
    for t in range(x.lagged.shape[0]):
        for j in range(count):
            one = x.sent_quick[t, slot, j]
            for k in range(count):
                now, old = x.sent_products[t, slot], x.sent_products[t, before]
                now[0, j, k] = fade * old[0, j, k] + one * x.sent_quick[t, slot, k]
                now[1, j, k] = fade * old[1, j, k] + one * x.sent_quick[t, before, k]


@compiled
def add_times(sums: Array, signals: Array, factor: float, fade: float, number: int) -> None:
    """``sums <- fade sums + factor signals``, so many of them: (n,) each."""
    for i in range(number):
        sums[i] = fade * sums[i] + factor * signals[i]


@compiled
def sent_with(s: BankSettings, x: BankState, a: int, older: int, j: int, i: int) -> float:
    """Return the sum of products of effector j by response a, or (``older`` 1) a block before, with signal i.

    Signals are the states and then the outputs.
    """
    return float(x.sent_sums[s.paired[a, older], j, i])


@compiled
def sent_by_sent(s: BankSettings, x: BankState, a: int, older: int, j: int, k: int) -> float:
    """Return the same of effectors j and k, both by response a or both a block before."""
    back = s.ahead + s.responses[a, 1] + older
    return float(x.sent_products[s.responses[a, 0], (x.response_block[0] - back) % x.sent_products.shape[1], 0, j, k])


@compiled
def sent_by_older(s: BankSettings, x: BankState, a: int, j: int, k: int) -> float:
    """Return the same of effector j by response a with effector k a block before."""
    back = s.ahead + s.responses[a, 1]
    return float(x.sent_products[s.responses[a, 0], (x.response_block[0] - back) % x.sent_products.shape[1], 1, j, k])


@compiled
def compare_responses(s: BankSettings, x: BankState, factor: Array, w: Array, z: Array) -> bool:
    """Hold all responses against that of now; return whether another one is taken."""
    number = s.responses.shape[0]
    others = number - s.lags.shape[0] + 1
    now = x.response[0]
    free = x.response_samples[0] - x.lagged.shape[1] - s.effectors_from - 3.0
    if free <= 0.0:
        return False
    for a in range(number):
        passes = 1
        while fit(s, x, a, free, factor, w, z) and passes < PASSES:
            passes += 1
        if a == now:
            find_hidden(s, x, factor, w)
    moving = 0.0
    for q in range(x.gate.shape[0]):
        moving += x.gate[q] / x.gate.shape[0]
    gain = min(LOOK * (1.0 - s.block_forgetting), 1.0) * moving
    best = now
    for a in range(others):
        apart = s.responses[a, 1] + x.response_part[a] - s.responses[now, 1]
        alike = s.responses[a, 0] == s.responses[now, 0]
        gained = gained_by(s, x, a, now, others, free, True)
        shown = gained_by(s, x, a, now, others, free, False)
        if alike and least_part(s, now) <= apart < 1.0 + BEYOND:
            gained, shown = min(gained, 0.0), min(shown, 0.0)  # its delay lies within the reach of that of now
        near = alike and -BEYOND <= apart < 0.0
        shown = min(shown, 0.0) if near else shown
        x.response_shown[a] += gain * (shown - FORGOTTEN * x.response_shown[a])
        x.response_evidence[a] += gain * (gained - FORGOTTEN * x.response_evidence[a])
        if x.response_evidence[a] > x.response_evidence[best] and not near:
            best = a
    lead = x.response_evidence[best]
    taken: bool = lead > (DECISIVE if now == 0 else AGAIN)
    if taken:
        x.response[0] = best
        for a in range(others):
            x.response_evidence[a] -= lead
            x.response_shown[a] = min(x.response_shown[a], 0.0)
    shape = shape_doubt(s, x)
    for a in range(others):
        if x.response_shown[a] > max(lead, 0.0):
            best, lead = a, x.response_shown[a]
    edge = abs(lateness(s, x, best) - lateness(s, x, now)) / RISE
    for q in range(x.response_doubt.shape[0]):
        doubt = 0.0 if taken else min(lead / DECISIVE, max(share_of_change(s, x, q, best, now), edge))
        x.response_doubt[q] = max(doubt, shape)
    return taken


@compiled
def lateness(s: BankSettings, x: BankState, a: int) -> float:
    """Return by how much response a comes after the deflections, lag and delay [s]."""
    delay = (s.responses[a, 1] + x.response_part[a]) * s.late * s.period
    return float(delay + s.lag_times[s.responses[a, 0]])


@compiled
def share_of_change(s: BankSettings, x: BankState, q: int, a: int, b: int) -> float:
    """Return by what share row q's effects are others with response a than with b, each by how far it has moved [1]."""
    change = 0.0
    effects = 0.0
    for j in range(x.response_effect.shape[2]):
        moves = sent_by_sent(s, x, b, 0, j, j)
        one, other = x.response_effect[a, q, j], x.response_effect[b, q, j]
        change += (one - other) * (one - other) * moves
        effects += other * other * moves
    return math.sqrt(change / effects) if effects > 0.0 else math.inf


@compiled
def shape_doubt(s: BankSettings, x: BankState) -> float:
    """Return the relative error of estimates by what is not known of an actuator, where a delay or a lag shows one.

    A delay of 10 to 25 ms may be the record's, and then effects are right; or it is a lag that was not found, which
    takes of an effect by its square, as far as the evidence leaves one (`excluded_lag`). Four aircraft in flight test,
    records 12 to 18 ms late, differentiated (seed 851): median |z| of B .09 -> .21, reliable .13 -> .16, covered 1.0.
    Commands of a foam aircraft of 2.6 kg, not one of ours, at 25 Hz, 10 flights in calm air: .17 reliable, covered in
    .89 -> .15, .85. Where a servo of second order and 40 to 70 ms in all is declared as a lag of that, 15 to 25 ms are
    found and effects are 1.1 to 1.5 of the truth, and no evidence shows it: B was covered in .69, now in .94 to .97.
    """
    response = s.responses[x.response[0]]
    if response[0] > 0:
        return UNSHAPED
    late = max(x.delay[MOMENTS, 0] + response[1] * s.late, 0.0) * s.period
    declared = UNSHAPED * min(max((late - QUICK) / (SLOW - QUICK), 0.0), 1.0) if s.servos else 0.0
    part = min(max((late - QUICK) / (LAG - QUICK), 0.0), 1.0)
    lag = min(LAGLESS * part * part, excluded_lag(s, x))
    return float(max(declared, lag, LAGLESS * min(max((late - RECORDS) / (ACTUATORS - RECORDS), 0.0), 1.0)))


@compiled
def excluded_lag(s: BankSettings, x: BankState) -> float:
    """Return the relative error of estimates by the largest lag that may still be in a delay, by its evidence.

    Against the shortest lag stands the evidence N: the share of it that there may be has a standard error of
    ``1/sqrt(2 N)``, of which two count.
    """
    most = -math.inf
    for a in range(s.responses.shape[0] - s.lags.shape[0] + 1):
        if s.responses[a, 0] == 1:
            most = max(most, x.response_evidence[a])
    return UNSHAPED * 2.0 / math.sqrt(-2.0 * most) if most < 0.0 else math.inf


@compiled
def summed(s: BankSettings, x: BankState, a: int, i: int, k: int, d: float) -> float:
    """Return the sum of products of what is regressed on: i and k < i or equal, of states and then effectors."""
    states = s.effectors_from
    if i < states:
        return float(x.response_sums[i, k])
    j, e = i - states, 1.0 - d
    if k < states:
        return e * sent_with(s, x, a, 0, j, k) + d * sent_with(s, x, a, 1, j, k)
    k -= states
    mixed = sent_by_older(s, x, a, k, j) + sent_by_older(s, x, a, j, k)
    return e * e * sent_by_sent(s, x, a, 0, j, k) + d * e * mixed + d * d * sent_by_sent(s, x, a, 1, j, k)


@compiled
def step_with(s: BankSettings, x: BankState, a: int, j: int, i: int, d: float) -> float:
    """Return the sum of products of effector j's step with what is regressed on, i as in `summed`."""
    if i < s.effectors_from:
        return sent_with(s, x, a, 1, j, i) - sent_with(s, x, a, 0, j, i)
    k = i - s.effectors_from
    newer = sent_by_older(s, x, a, k, j) - sent_by_sent(s, x, a, 0, j, k)
    older = sent_by_sent(s, x, a, 1, j, k) - sent_by_older(s, x, a, j, k)
    return (1.0 - d) * newer + d * older


@compiled
def find_steps(s: BankSettings, x: BankState, a: int, d: float) -> None:
    """Fill in ``x.response_steps`` and ``x.response_squares``: sums of products of steps with regressors and steps."""
    count = x.lagged.shape[1]
    for j in range(count):
        for i in range(s.effectors_from + count):
            x.response_steps[j, i + 1] = step_with(s, x, a, j, i, d)
        for k in range(count):
            square = sent_by_sent(s, x, a, 1, j, k) - sent_by_older(s, x, a, k, j)
            x.response_squares[j, k] = square + sent_by_sent(s, x, a, 0, j, k) - sent_by_older(s, x, a, j, k)


@compiled
def gained_by(s: BankSettings, x: BankState, a: int, now: int, others: int, free: float, certain: bool) -> float:
    """Return by how much response a is likelier than that of now, no more than noise leaves of it [1].

    Parameters
    ----------
    s, x
        Settings and state.
    a, now
        Responses.
    others
        How many are no filters without a delay.
    free
        Samples, as for `fit`.
    certain
        Whether what stands in for noisy states gains nothing. What may be a lag is in doubt, whether it does or not.
    """
    lag, early = s.responses[a, 0], s.responses[a, 1] < 0
    hidden = certain and (s.responses[a, 1] > s.responses[now, 1] or (lag > 0 and s.responses[now, 0] == 0))
    averaged = averaged_share(x.response_part[a]) if early and lag == s.responses[now, 0] else 0.0
    gained = likelier(s, x, a, now, free, averaged, hidden)
    if lag > 0 and s.responses[now, 0] == 0:
        least = likelier(s, x, a, now, free, 1.0, hidden) if early else -math.inf
        gained = max(min(gained, likelier(s, x, a, others + lag - 1, free, 0.0, False)), least)
    if lag > 0 and turns_round(s, x, a, now):
        gained = min(gained, 0.0)
    return gained


@compiled
def likelier(s: BankSettings, x: BankState, a: int, b: int, free: float, averaged: float, hidden: bool) -> float:
    """Return by how much response a is likelier than b, by the rows that answer the effectors [1].

    Parameters
    ----------
    s, x
        Settings and state.
    a, b
        Responses.
    free
        Samples, as for `fit`.
    averaged
        Share of the variance of the noise in deflections that a averages away: no row gains by that.
    hidden
        Whether no row gains by standing in for states that noise hides; b is the response of now then.
    """
    total = 0.0
    early = s.responses[a, 1] < 0
    for q in range(x.response_fit.shape[1]):
        if early and seems_early(s, x, q) > BEYOND:
            continue
        if max(x.response_fit[a, q, 1], x.response_fit[b, q, 1]) < ANSWERS:
            continue
        gained = x.response_fit[a, q, 0] - x.response_fit[b, q, 0]
        noise = averaged * x.response_fit[b, q, 2] + (x.response_hidden[q] if hidden else 0.0)
        if gained > 0.0 and noise > 0.0:
            gained = max(gained + weight_of(s, x, q, free) * logarithm(max(1.0 - noise, REDUNDANT)), 0.0)
        total += gained
    return total


@compiled
def find_hidden(s: BankSettings, x: BankState, factor: Array, w: Array) -> None:
    """Find which share of what is left of each row noise in the states makes, ``x.response_hidden``, after its `fit`.

    Of a state with the share rho of noise in what the other regressors leave of it, least squares finds ``1 - rho`` of
    the effect; what else goes with the state takes ``theta^2 n sigma^2 / (1 - rho)`` of what is left at most, theta as
    it was found. (p,) scratch.
    """
    for q in range(x.response_hidden.shape[0]):
        x.response_hidden[q] = 0.0
    for i in range(1, s.effectors_from + 1):
        noise = x.response_samples[0] * state_noise(s, x, i - 1, x.white_noise[i - 1])
        if x.measured[i - 1] >= 1.0:
            noise /= s.late
        for k in range(w.shape[0]):
            w[k] = 0.0
        w[i] = 1.0
        share = noise * solve_forward(factor, w, i)
        for q in range(x.response_hidden.shape[0]):
            effect = x.response_states[q, i - 1]
            hidden = effect * effect * noise / max(1.0 - share, REDUNDANT)
            if x.response_row[q, 0] > 0.0:
                x.response_hidden[q] += hidden / x.response_row[q, 0]


@compiled
def averaged_share(d: float) -> float:
    """Return the share of the variance of white noise that goes where d of one sample and ``1 - d`` of another count.

    What is in the sample before is in the states as well; what comes after is not, and says more.
    """
    return max(2.0 * d * (1.0 - d), 0.0)


@compiled
def weight_of(s: BankSettings, x: BankState, q: int, free: float) -> float:
    """Return ``n_q / 2 c_q`` of row q, of so many free samples, over the blocks of l samples."""
    one = autocorrelation(x, q)
    rho = one
    for _ in range(s.late - 1):
        rho *= one
    return 0.5 * free * (1.0 - rho) / (1.0 + rho)


@compiled
def turns_round(s: BankSettings, x: BankState, a: int, b: int) -> bool:
    """Return whether effects by response a are contrary to those by b, by the rows that count, each over its output.

    Deflections of before stand in for a state that they have made and that is noisy itself: by what it does, contrary.
    """
    total = 0.0
    for q in range(x.response_fit.shape[1]):
        if max(x.response_fit[a, q, 1], x.response_fit[b, q, 1]) < ANSWERS:
            continue
        for j in range(x.response_effect.shape[2]):
            output = s.effectors_from + q
            moves = sent_by_sent(s, x, b, 0, j, j) / max(x.response_sums[output, output], TINY)
            total += x.response_effect[a, q, j] * x.response_effect[b, q, j] * moves
    return bool(total < 0.0)


@compiled
def seems_early(s: BankSettings, x: BankState, q: int) -> float:
    """Return by how much row q's output may seem to come early by the noise in its own state, over l.

    Least squares makes the effect of the state, ``theta``, smaller by the share of noise in it. That is missing of what
    has answered motion of frequency w: ``share theta / w^2`` sooner; what is quick begins at the mean's corner.
    """
    square = x.response_sums[q, q]
    noise = x.response_samples[0] * x.state_median[q] / (MEDIAN * s.late)
    share = min(noise / square, 1.0) if square > 0.0 else 1.0
    memory = s.period / s.quick
    return float(share * abs(x.mixed[q, q + 1]) * memory * memory / (s.late * s.period))


@compiled
def fit(s: BankSettings, x: BankState, a: int, free: float, factor: Array, w: Array, z: Array) -> bool:
    """Find the profile likelihood of response a, ``x.response_fit``, and move its ``d``; whether by the largest step.

    (p, p), (p,) and (p,) scratch; regressors stand at 1 and following, as everywhere.
    """
    states = s.effectors_from
    count = x.lagged.shape[1]
    p = states + count + 1
    rows = x.gate.shape[0]
    d = x.response_part[a]
    for i in range(1, p):
        for k in range(1, i + 1):
            factor[i, k] = summed(s, x, a, i - 1, k - 1, d)
    factorise(factor, p)
    find_steps(s, x, a, d)
    product = 0.0
    own = 0.0
    for q in range(rows):
        find_row(s, x, a, q, d, factor, w, z)
        for j in range(count):
            x.response_effect[a, q, j] = w[states + 1 + j]
        for i in range(states):
            x.response_states[q, i] = w[i + 1]
        x.response_row[q, 0] = w[0]
        x.response_row[q, 1] = z[0]
        x.response_row[q, 2] = z[1]
        x.response_row[q, 3] = z[2]
        if w[0] > 0.0:
            product += z[0] / w[0]
            own += z[1] / w[0]
    step = product / own if own > 0.0 else 0.0
    cut = abs(step) > STEP
    step = min(max(d + min(max(step, -STEP), STEP), least_part(s, a)), 1.0 + BEYOND) - d
    x.response_part[a] = d + step
    for q in range(rows):
        left = x.response_row[q, 0] - step * (2.0 * x.response_row[q, 1] - step * x.response_row[q, 2])
        left = max(left, REDUNDANT * x.response_sums[states + q, states + q])
        for i in range(x.response_fit.shape[2]):
            x.response_fit[a, q, i] = 0.0
        if left > 0.0:
            noise = 0.0
            for j in range(count):
                effect = x.response_effect[a, q, j]
                noise += effect * effect * x.response_samples[0] * most_noise(s, x, j) / s.late
            x.response_fit[a, q, 0] = -weight_of(s, x, q, free) * logarithm(left)
            x.response_fit[a, q, 2] = noise / left
            unexplained = left
            if s.straddle == 0:
                white = x.response_samples[0] * x.output_median[q] / (MEDIAN * s.late)
                unexplained = max(left - white, LEAST_LEFT * left)
            x.response_fit[a, q, 1] = 1.0 - unexplained / max(x.response_row[q, 3] - left + unexplained, unexplained)
    return cut and step != 0.0


@compiled
def find_row(s: BankSettings, x: BankState, a: int, q: int, d: float, factor: Array, w: Array, z: Array) -> None:
    """Regress row q's output: its sum of squares that is left in w[0], and by the states alone in z[2].

    What d would change: ``z[0]`` is the sum of its products with the output, ``z[1]`` of its squares, both without what
    the regressors make of it.
    """
    states = s.effectors_from
    count = x.lagged.shape[1]
    p = states + count + 1
    output = states + q
    w[0] = 0.0
    for i in range(states):
        w[i + 1] = x.response_sums[output, i]
    for j in range(count):
        w[states + 1 + j] = (1.0 - d) * sent_with(s, x, a, 0, j, output) + d * sent_with(s, x, a, 1, j, output)
    left = x.response_sums[output, output] - solve_forward(factor, w, 0)
    by_effectors = 0.0
    for i in range(states + 1, p):
        by_effectors += w[i] * w[i]
    solve_backward(factor, w)
    for i in range(p):
        z[i] = 0.0
    size = 0.0
    product = 0.0
    for j in range(count):
        effect = w[states + 1 + j]
        product += effect * (sent_with(s, x, a, 1, j, output) - sent_with(s, x, a, 0, j, output))
        for i in range(1, p):
            z[i] += effect * x.response_steps[j, i]
        for k in range(count):
            size += effect * w[states + 1 + k] * x.response_squares[j, k]
    for i in range(1, p):
        product -= z[i] * w[i]
    own = size - solve_forward(factor, z, 0)
    w[0] = max(left, 0.0)
    z[0] = product if own > APART * size else 0.0
    z[1] = own if own > APART * size else 0.0
    z[2] = max(left, 0.0) + by_effectors
