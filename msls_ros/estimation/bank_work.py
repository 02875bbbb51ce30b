"""Scratch of the compiled loop of the bank, `BankWork`: what it works in during one sample; it holds no state."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msls_ros.estimation.bank_loop_settings import BankSettings
from msls_ros.estimation.compiled import passed_by_reference
from msls_ros.estimation.kernel import Array, Integers


@passed_by_reference
class BankWork(NamedTuple):
    """Scratch of one sample; no state."""

    phi: Array
    """(p,) regressor, constant first."""
    outputs: Array
    """(r,) outputs that go with it, see `bank_responses`."""
    y: Array
    """(r,) outputs, put in step."""
    noise: Array
    """(r,) variance of the noise in the states, as regressors."""
    w: Array
    """(p,)"""
    squares: Array
    """(p,) squared standard errors."""
    row: Array
    """(p, m) rows that are rotated in."""
    z: Array
    """(p, m) right-hand sides."""
    K: Array
    """(p, m) gains."""
    V: Array
    """(p, p, m) inverses of the factors."""
    c: Array
    """(m,) cosines, as t the sines."""
    t: Array
    left: Array
    """(m,) what is left of the right-hand side."""
    root: Array
    """(m,) what the factors shrink by, as first their row 0."""
    first: Array
    weight: Array
    """(m,) weight of the sample in each member, and its root [1]."""
    root_weight: Array
    loss: Array
    """(m,) share of the information that is forgotten [1]."""
    e: Array
    """(m,) delayed prediction errors; exponents of the weights."""
    concerned: Integers
    """(r,) 1 for rows that count."""
    change: Array
    """(k,) by which share the effect of each surface has changed, with its variance, see `bank_losses`."""
    variance: Array
    deviation: Array
    """(k,) how many standard errors that is, positive for a loss."""
    explained: Array
    """(k,) what it explains of what has changed."""
    by_state: Array
    """(p,) what a change of one state explains; the largest first."""
    against: Array
    """(r, k)"""
    information: Array
    """(r, k) about the change, by row."""
    reference: Array
    """(r, k) squared relative errors of what it is compared with [1]."""
    difference: Array
    """(p,) of its estimates from older ones."""
    factor: Array
    """(p, p) of one member."""
    whitening: Array
    """(p,) by what its coordinates of a change are multiplied, for all to have the same noise [1]."""
    steps: Array
    """(k, p) the direction of each surface's loss in it, its squared length first."""
    white_steps: Array
    """(k, p) the same, and (p, p) the factor's columns as rows, where coordinates have the same noise."""
    white_columns: Array
    noise_moves: Array
    """(p, p) by state, which way noise in it moves the estimates there, see `bank_noise_moves`."""


def make_bank_work(s: BankSettings, rows: int) -> BankWork:
    """Allocate the scratch."""
    p, m = s.prior.shape
    row, z, K = np.zeros((p, m)), np.zeros((p, m)), np.zeros((p, m))
    c, t, left, root, first, weight, root_weight, loss, e = (np.zeros(m) for _ in range(9))
    k = len(s.gains)
    change, variance, deviation, explained = (np.zeros(k) for _ in range(4))
    return BankWork(
        *(np.zeros(p), np.zeros(rows), np.zeros(rows), np.zeros(rows), np.zeros(p), np.zeros(p)),
        *(row, z, K, np.zeros((p, p, m)), c, t, left),
        *(root, first, weight, root_weight, loss, e),
        np.zeros(rows, np.int64),
        *(change, variance, deviation, explained, np.zeros(p)),
        *(
            np.zeros((rows, k)),
            np.zeros((rows, k)),
            np.zeros((rows, k)),
            np.zeros(p),
            np.zeros((p, p)),
            np.ones(p),
            np.zeros((k, p)),
            np.zeros((k, p)),
            np.zeros((p, p)),
            np.zeros((p, p)),
        ),
    )
