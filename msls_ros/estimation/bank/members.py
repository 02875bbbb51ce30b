"""The bank of memories: its members, and what one sample does to a member's factor.

A member is exponentially weighted least squares as a square-root factor, like RLS, with a memory ``tau``, a prior width
``pi`` and a drift ``kappa`` of its own. Nobody knows beforehand which memory suits: long ones average noise, short ones
follow a change; noise and aircraft decide. So all of them run side by side on the same samples, and `bank.mixing` mixes
them, per equation and coefficient, by how well each has predicted. One sample of one member (p regressors, the constant
first, sigma the bank's unit of each regressor)::

    R <- sqrt(lambda) R,   row 0 also / sqrt(1 + kappa^2 R_00^2)      forgetting; the constant walks by kappa a sample
    [ R              ]     Givens    [ R' ]
    [ eps prior row  ]   -------->   [ 0  ]                           one row of the prior in turn: no wind-up
    [ R'     | 0 ]         Givens    [ R'' | z ]
    [ w phi  | w ]       -------->   [ 0   | s ]                      eq 10; s = w/sqrt(1 + w^2 phi' (R'R)^-1 phi)
    R'' K = z,   theta_q += K e_q                                     eqs 9 and 11, for every row q of the group

``lambda = exp(-dt/tau)``, w = 1. A *held* member counts its memory in excited seconds: the share g of the present
energy of the outputs of its axis in the energy that is remembered (`bank.energy`) multiplies ``1 - lambda``, and is the
weight of the sample, ``w = sqrt(g)``. Quiet flight takes nothing away then, nor does the noise of a minute of it, which
is all that regressors hold there, draw what was learnt towards nothing; nor do lateral inputs what an elevator input
taught, for there is one set of held members for each axis. At a start ``R = diag(sigma_i/pi)``.

The walk of the constant is exact: a random walk of variance kappa^2 (in residual variances) added to the first
coefficient turns the information ``R_00^2`` into ``R_00^2/(1 + kappa^2 R_00^2)``; the others keep theirs, because the
constant stands first.

Members lie along the last axis of every array: all of them undergo the same rotations with numbers of their own, so the
innermost loops run over them without a branch or a sum, and the compiler makes vector instructions of them.

References
----------
Golub and Van Loan, *Matrix Computations*, 4th ed., section 6.5 (updating). Kulhavy and Zarrop, "On a general concept of
forgetting", Int. J. Control 58 (1993). Fortescue, Kershenbaum and Ydstie, "Implementation of self-tuning regulators
with variable forgetting factors", Automatica 17 (1981): forget as fast as information comes.
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.ramps import is_pending
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.bank.work import BankWork
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.elementary import logarithm
from msls_ros.estimation.kernel import Array

RETURN = 2
"""A row of the prior comes back at every so manieth sample."""

REFRESH = 4
"""The information is computed anew at every so manieth sample, and at every one after a restart."""

TINY = 1e-300
"""Added to sums of squares of which the root or the logarithm is taken: far below the last bit of what is not zero."""


@compiled
def update_members(s: BankSettings, x: BankState, g: int, y: Array, work: BankWork) -> None:
    """Take the sample of ``work.phi`` and y (r,) into all members of group g: factors, then estimates of its rows."""
    p, members = work.row.shape
    R = x.R[g]
    prepare_forgetting(s, R, x.age[g], x.axis_gate[g], work)
    weigh_sample(s, x.axis_gate[g], work)
    count = x.taken[g]
    for m in range(members):
        count[m] = (1.0 - work.loss[m]) * count[m] + work.weight[m]
        work.e[m] = work.weight[m] / count[m] if x.age[g] > 0 else 1.0
    for q in range(y.shape[0]):
        noisy = x.noisy[g, q]
        for m in range(members):
            noisy[m] = (1.0 - work.loss[m]) * noisy[m] + work.weight[m] * work.shown[q]
        noisy = x.noisy_white[g, q]
        for m in range(members):
            noisy[m] = (1.0 - work.loss[m]) * noisy[m] + work.weight[m] * x.white_noise[q]
    for i in range(1, s.effectors_from + 1):
        centre = x.centre[g, i]
        for m in range(members):
            centre[m] += work.e[m] * (work.phi[i] - centre[m])
    if x.samples[0] % RETURN == 0 and x.age[g] > 0:
        turn = (x.samples[0] // RETURN) % p
        for i in range(p):
            for m in range(members):
                work.row[i, m] = 0.0
        for m in range(members):
            work.row[turn, m] = s.wind_up * s.prior[turn, m] * math.sqrt(RETURN * p * work.loss[m])
        rotate(R, work, turn)
        for m in range(members):
            work.root[m] = 1.0
            work.first[m] = 1.0
    for m in range(members):
        work.left[m] = work.root_weight[m]
    for i in range(p):
        for m in range(members):
            work.row[i, m] = work.root_weight[m] * work.phi[i]
    rotate(R, work, 0)
    deviation = x.deviation[g]
    log = x.log[g]
    for m in range(members):
        square = work.left[m] * work.left[m]
        deviation[m] = math.sqrt(square / (1.0 - (1.0 - work.weight[m]) * square / work.weight[m]))
    for m in range(members):
        log[m] = -2.0 * logarithm(deviation[m])
    solve_gains(R, work.z, work.K)
    if x.samples[0] % REFRESH == 0 or x.age[g] < 2 * p:
        find_information(R, work.V, x.info[g])
    for q in range(y.shape[0]):
        if x.group[q] == g:
            correct(x.members[q], work.phi, y[q], work.K, x.errors[q])
    for j in range(x.sensitivity.shape[1]):
        correct(x.sensitivity[g, j], work.phi, x.step_back[j], work.K, work.e)
    if is_pending(x, g):
        for h in range(s.ramp_lengths.shape[0]):
            grown = float(min(x.ramp_samples[g], s.ramp_lengths[h]))
            correct(x.ramps[g, h], work.phi, grown, work.K, work.e)
        x.ramp_samples[g] += 1
    x.age[g] += 1


@compiled
def weigh_sample(s: BankSettings, gates: Array, work: BankWork) -> None:
    """Find how much the sample counts in each member, ``work.weight``: 1, but in those that are held their gate."""
    for m in range(work.weight.shape[0]):
        work.weight[m] = 1.0 - s.held[m] * (1.0 - max(gates[s.axis[m]], s.quiet))
        work.root_weight[m] = math.sqrt(work.weight[m])


@compiled
def prepare_forgetting(s: BankSettings, R: Array, age: int, gates: Array, work: BankWork) -> None:
    """Find by what the rows of the factors shrink before the sample: ``work.root``, and ``work.first`` for row 0."""
    for m in range(work.root.shape[0]):
        rate = 1.0 - s.forgetting[m]
        rate *= 1.0 - s.held[m] * (1.0 - gates[s.axis[m]])
        walk = s.drift[m] * R[0, 0, m]
        root = math.sqrt(1.0 - rate) if age > 0 else 1.0
        work.loss[m] = rate
        work.root[m] = root
        work.first[m] = root / math.sqrt(1.0 + walk * walk) if age > 0 else 1.0


@compiled
def rotate(R: Array, work: BankWork, start: int) -> None:
    """Shrink the factors and rotate the rows ``work.row`` into them (eq 10), right-hand side ``[0; work.left]``.

    Parameters
    ----------
    R
        (p, p, m) upper triangular; updated.
    work
        ``row`` (p, m), zero before ``start``, is destroyed; ``z`` (p, m) becomes the right-hand side of R, ``left``
        (m,) what is left of its own.
    start
        First element of the rows that is not zero.
    """
    p, members = work.row.shape
    row = work.row
    c = work.c
    t = work.t
    left = work.left
    for j in range(p):
        shrink = work.first if j == 0 else work.root
        if j < start:
            for k in range(j, p):
                x = R[j, k]
                for m in range(members):
                    x[m] *= shrink[m]
            continue
        pivot = R[j, j]
        y = row[j]
        z = work.z[j]
        for m in range(members):
            a = pivot[m] * shrink[m]
            b = y[m]
            r = math.sqrt(a * a + b * b + TINY)
            c[m] = a / r
            t[m] = b / r
            pivot[m] = r
            z[m] = t[m] * left[m]
            left[m] = c[m] * left[m]
        for k in range(j + 1, p):
            rotate_pair(R[j, k], row[k], c, t, shrink)


@compiled
def rotate_pair(x: Array, y: Array, c: Array, t: Array, shrink: Array) -> None:
    """Shrink x, then rotate it with y, for all members: (m,) each."""
    for m in range(x.shape[0]):
        a = x[m] * shrink[m]
        b = y[m]
        x[m] = c[m] * a + t[m] * b
        y[m] = c[m] * b - t[m] * a


@compiled
def solve_gains(R: Array, z: Array, K: Array) -> None:
    """Back-substitute ``R K = z`` (eq 9): (p, p, m), (p, m), (p, m) out."""
    p, members = K.shape
    for j in range(p - 1, -1, -1):
        gain = K[j]
        for m in range(members):
            gain[m] = z[j, m]
        for k in range(j + 1, p):
            x = R[j, k]
            known = K[k]
            for m in range(members):
                gain[m] -= x[m] * known[m]
        pivot = R[j, j]
        for m in range(members):
            gain[m] /= pivot[m]


@compiled
def correct(theta: Array, phi: Array, y: float, K: Array, e: Array) -> None:
    """Predict an output, and correct the estimates of one row by the error (eq 11).

    Parameters
    ----------
    theta
        (p, m) estimates; updated.
    phi
        (p,) regressor.
    y
        Output.
    K
        (p, m) gains.
    e
        (m,) out: the prediction errors.
    """
    for m in range(e.shape[0]):
        e[m] = y
    for i in range(phi.shape[0]):
        of = theta[i]
        for m in range(e.shape[0]):
            e[m] -= of[m] * phi[i]
    for i in range(phi.shape[0]):
        of = theta[i]
        gain = K[i]
        for m in range(e.shape[0]):
            of[m] += gain[m] * e[m]


@compiled
def find_information(R: Array, V: Array, info: Array) -> None:
    """Write ``1 / ((R'R)^-1)_ii``, what the data say of each coefficient alone.

    Parameters
    ----------
    R
        (p, p, m) upper triangular.
    V
        (p, p, m) scratch: the inverses of R.
    info
        (p, m) out.
    """
    p, members = info.shape
    for k in range(p):
        pivot = R[k, k]
        own = V[k, k]
        total = info[k]
        for m in range(members):
            own[m] = 1.0 / pivot[m]
            total[m] = own[m] * own[m]
        for i in range(k):
            v = V[i, k]
            for m in range(members):
                v[m] = 0.0
            for n in range(i, k):
                subtract_product(v, V[i, n], R[n, k])
            total = info[i]
            for m in range(members):
                v[m] *= own[m]
                total[m] += v[m] * v[m]
    for i in range(p):
        total = info[i]
        for m in range(members):
            total[m] = 1.0 / total[m]


@compiled
def subtract_product(v: Array, a: Array, b: Array) -> None:
    """``v -= a b`` for all members: (m,) each."""
    for m in range(v.shape[0]):
        v[m] -= a[m] * b[m]
