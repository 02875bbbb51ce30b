"""Scratch of the compiled loop of the bank, `BankWork`: what it works in during one sample; it holds no state."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.compiled import passed_by_reference
from msls_ros.estimation.kernel import Array, Integers


@passed_by_reference
class BankWork(NamedTuple):
    """Scratch of one sample; no state."""

    phi: Array
    """(p,) regressor, constant first."""
    outputs: Array
    """(r,) outputs that go with it, see `bank.responses`."""
    y: Array
    """(r,) outputs, put in step."""
    noise: Array
    """(r,) variance of the noise in the states, as regressors."""
    shown: Array
    """(r,) as much of that as has shown, gusts and all."""
    extended: Array
    """(p + v,) the regressors, and D of the velocities, see `bank.gusts`."""
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
    """(k,) by which share the effect of each surface has changed, with its variance, see `bank.losses`."""
    variance: Array
    deviation: Array
    """(k,) how many standard errors that is, positive for a loss."""
    explained: Array
    """(k,) what it explains of what has changed."""
    asked: Integers
    """(1,) the surface of whose loss it is asked which others could have made it; negative: none."""
    overlap: Array
    """(k,) what is said of its loss and of that of each other surface at once."""
    by_state: Array
    """(p,) what a change of one state explains; the largest first."""
    by_error: Array
    """(c,) what the error of one effector's older effect explains, of a row."""
    against: Array
    """(r, k)"""
    information: Array
    """(r, k) about the change, by row."""
    lone_against: Array
    """(r, k) both where the surface's effect through incidence may have changed as well (`bank.incidence`)."""
    lone_information: Array
    reference: Array
    """(r, k) squared relative errors of what it is compared with [1]."""
    difference: Array
    """(p,) scratch: a column."""
    whitened: Array
    """(4, p) scratch: a direction, a change and two columns."""
    factor: Array
    """(p, p) scratch: a factor."""
    columns: Array
    """(p, p) the columns of the factor of the member that is compared, as rows."""
    along: Array
    """(k,) what a row's change has in common with the direction of each surface's loss, and its squared length."""
    size: Array
    resting: Array
    """(c,) variances of the noise in the deflections, and of that which cannot be excluded."""
    slow: Array
    whitening: Array
    """(p,) by what its coordinates of a change are multiplied, for all to have the same noise [1]."""
    steps: Array
    """(k, p) the direction of each surface's loss in it, its squared length first."""
    white_steps: Array
    """(k, p) the same, and (p, p) the factor's columns as rows, where coordinates have the same noise."""
    white_columns: Array
    ramps: Array
    """(h, p) the directions of moments that grow for a while in it, see `bank.ramps`."""
    by_ramp: Array
    """(h,) what they explain."""
    noise_moves: Array
    """(p, p) by state, which way noise in it moves the estimates there, see `bank.noise_moves`."""
    moved: Array
    """(p,) squared lengths of these."""


def make_bank_work(s: BankSettings, rows: int) -> BankWork:
    """Allocate the scratch."""
    (p, m), k = s.prior.shape, len(s.gains)
    return BankWork(
        phi=np.zeros(p),
        outputs=np.zeros(rows),
        y=np.zeros(rows),
        noise=np.zeros(rows),
        shown=np.zeros(rows),
        extended=np.zeros(p + len(s.velocities)),
        w=np.zeros(p),
        squares=np.zeros(p),
        row=np.zeros((p, m)),
        z=np.zeros((p, m)),
        K=np.zeros((p, m)),
        V=np.zeros((p, p, m)),
        c=np.zeros(m),
        t=np.zeros(m),
        left=np.zeros(m),
        root=np.zeros(m),
        first=np.zeros(m),
        weight=np.zeros(m),
        root_weight=np.zeros(m),
        loss=np.zeros(m),
        e=np.zeros(m),
        concerned=np.zeros(rows, np.int64),
        change=np.zeros(k),
        variance=np.zeros(k),
        deviation=np.zeros(k),
        explained=np.zeros(k),
        asked=np.full(1, -1),
        overlap=np.zeros(k),
        by_state=np.zeros(p),
        by_error=np.zeros(s.gains.shape[1]),
        against=np.zeros((rows, k)),
        information=np.zeros((rows, k)),
        lone_against=np.zeros((rows, k)),
        lone_information=np.zeros((rows, k)),
        reference=np.zeros((rows, k)),
        difference=np.zeros(p),
        whitened=np.zeros((4, p)),
        factor=np.zeros((p, p)),
        columns=np.zeros((p, p)),
        along=np.zeros(k),
        size=np.zeros(k),
        resting=np.zeros(s.gains.shape[1]),
        slow=np.zeros(s.gains.shape[1]),
        whitening=np.ones(p),
        steps=np.zeros((k, p)),
        white_steps=np.zeros((k, p)),
        white_columns=np.zeros((p, p)),
        ramps=np.zeros((len(s.ramp_lengths), p)),
        by_ramp=np.zeros(len(s.ramp_lengths)),
        noise_moves=np.zeros((p, p)),
        moved=np.zeros(p),
    )
