"""Starting anew: allocates the bank's state and clears it at a reset; clears the factors of a group at an alarm."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from msls_ros.estimation.bank.changes import BLOCKS
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.ramps import begin_ramps
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled


def make_bank_state(s: BankSettings, rows: int, groups: int) -> BankState:
    """Allocate a state; `clear_bank` makes it valid."""
    return BankState(
        **_estimates(s, rows, groups),
        **_energies(s, rows, groups),
        **_detection(s, rows),
        **_responses(s, rows, groups),
        **_noise(s, rows),
        **_losses(s, rows, groups),
        **_errors(s, rows, groups),
    )


def _estimates(s: BankSettings, rows: int, groups: int) -> dict[str, Any]:
    """Allocate members, their evidence and the mixture of them."""
    p, m = s.prior.shape
    return dict(
        R=np.zeros((groups, p, p, m)),
        info=np.zeros((groups, p, m)),
        deviation=np.zeros((groups, m)),
        log=np.zeros((groups, m)),
        taken=np.zeros((groups, m)),
        noisy=np.zeros((groups, rows, m)),
        noisy_white=np.zeros((groups, rows, m)),
        centre=np.zeros((groups, p, m)),
        kept_info=np.zeros((groups, p)),
        age=np.zeros(groups, np.int64),
        group=np.zeros(rows, np.int64),
        members=np.zeros((rows, p, m)),
        errors=np.zeros((rows, m)),
        past=np.zeros((s.delay + 1, rows, p, m)),
        mixed=np.zeros((rows, p)),
        origin=np.zeros((rows, p)),
        known=np.ones((rows, p)),
        theta=np.zeros((rows, p)),
        sharpest=np.zeros(rows, np.int64),
        weight=np.zeros((rows, m)),
        evidence=np.zeros((rows, 3, m)),
        judged=np.zeros(rows),
    )


def _energies(s: BankSettings, rows: int, groups: int) -> dict[str, Any]:
    """Allocate energies that say what is excited."""
    p = s.prior.shape[0]
    return dict(
        mean=np.zeros(rows),
        now=np.zeros(rows),
        foreseen=np.zeros(rows),
        remembered=np.zeros(rows),
        phi_mean=np.zeros(p),
        phi_remembered=np.zeros(p),
        phi_last=np.zeros(p),
        step_remembered=np.zeros(p),
        gate=np.zeros(rows),
        output_error=np.zeros(rows),
        energy_share=np.ones((rows, s.forgetting.shape[0])),
        axis_gate=np.ones((groups, 2)),
    )


def _detection(s: BankSettings, rows: int) -> dict[str, Any]:
    """Allocate prediction errors, and what is looked for in them."""
    p = s.prior.shape[0]
    w = int(s.windows[-1])
    return dict(
        ring=np.zeros((rows, w)),
        surprise=np.zeros((rows, w)),
        allowed=np.zeros((rows, w)),
        excused=np.zeros(w),
        signed=np.zeros((rows, w)),
        mean_square=np.zeros((rows, len(s.windows), w)),
        mean_base=np.zeros((rows, 2 + len(s.windows))),
        smaller=np.zeros((rows, w)),
        square_moved=np.zeros((rows, p)),
        square_hidden=np.zeros((rows, p)),
        square_past=np.zeros((2, rows, p)),
        counted=np.zeros(rows, np.int64),
        base=np.zeros((rows, 3)),
        e=np.zeros(rows),
        squares=np.zeros((rows, len(s.forgetting))),
        residual=np.zeros((rows, 2)),
        colour=np.zeros((rows, 2)),
    )


def _responses(s: BankSettings, rows: int, groups: int) -> dict[str, Any]:
    """Allocate lags and delays between deflections and outputs."""
    p, m = s.prior.shape
    v = len(s.velocities)
    w = p + v
    effectors = s.effectors_to - s.effectors_from
    others = len(s.responses) - len(s.lags) + 1
    early = int(-s.responses[:others, 1].min())
    back, signals = int(s.responses[:, 1].max()) + s.ahead + 2, s.effectors_from + rows
    return dict(
        moving=np.zeros((2, p)),
        shapes=np.ones((2, 2)),
        quick=np.zeros(p),
        quick_past=np.zeros((s.late, effectors)),
        quick_late=np.zeros(effectors),
        quick_mean=np.zeros(p),
        state_motion=np.zeros((4, p)),
        slow_mean=np.zeros(p),
        quick_samples=np.zeros(1),
        moment=np.zeros((p, p)),
        together=np.zeros(1, np.int64),
        together_factor=np.zeros((effectors, effectors)),
        together_moves=np.zeros(effectors),
        quick_moment=np.zeros((effectors, p)),
        predictors=np.zeros((s.straddle + 1, 2, rows, p)),
        lagged=np.zeros((len(s.lags), effectors)),
        sent=np.zeros((len(s.lags), (back + 1) * s.late, effectors)),
        block_sent=np.zeros((len(s.lags), effectors)),
        block=np.zeros(s.effectors_from + rows),
        sent_mean=np.zeros((len(s.lags), effectors)),
        sent_quick=np.zeros((len(s.lags), back, effectors)),
        output_past=np.zeros((3, rows)),
        output_median=np.zeros(rows),
        held=np.zeros((early * s.late + 1, s.effectors_from + rows)),
        response_mean=np.zeros(s.effectors_from + rows),
        response_past=np.zeros((back, s.effectors_from + rows)),
        response_sums=np.zeros((signals, signals)),
        sent_sums=np.zeros((len(s.pairs), effectors, signals)),
        sent_products=np.zeros((len(s.lags), back, 2, effectors, effectors)),
        response_samples=np.zeros(1),
        response_block=np.zeros(1, np.int64),
        response_part=np.zeros(len(s.responses)),
        response_evidence=np.zeros(len(s.responses)),
        response_shown=np.zeros(len(s.responses)),
        response_doubt=np.zeros(rows),
        response_steps=np.zeros((effectors, p)),
        response_squares=np.zeros((effectors, effectors)),
        response_row=np.zeros((rows, 4)),
        response_fit=np.zeros((len(s.responses), rows, 3)),
        response_effect=np.zeros((len(s.responses), rows, effectors)),
        response_states=np.zeros((rows, s.effectors_from)),
        response_hidden=np.zeros(rows),
        response=np.zeros(1, np.int64),
        recent=np.zeros((s.latest + s.late + 3, effectors)),
        delay=np.zeros((2, 5)),
        output_mean=np.zeros(rows),
        early=np.zeros((rows, p)),
        answer=np.zeros((rows, effectors)),
        steps=np.zeros((effectors, effectors)),
        step_back=np.zeros(effectors),
        window_sums=np.zeros((BLOCKS, w, w)),
        window_outputs=np.zeros((BLOCKS, w, rows)),
        window_block=np.zeros(BLOCKS, np.int64),
        gust_sums=np.zeros((w, w)),
        gust_outputs=np.zeros((w, rows)),
        gust_mean=np.zeros(w),
        gust_factor=np.zeros((w, w)),
        gust_left=np.zeros(w),
        gust_theta=np.zeros((rows, w)),
        gust_direction=np.zeros((v, w)),
        gust_scatter=np.zeros((rows, v)),
        gust_effect=np.zeros((rows, v)),
        past_residuals=np.zeros((int(max(s.feedback_lags)) + 1, rows)),
        followed_residuals=np.zeros((rows, len(s.feedback_lags), p)),
        feedback_square=np.zeros((rows, p)),
        gust_bias=np.zeros((rows, v)),
        gust_blocks=np.zeros(1, np.int64),
        window_key=np.zeros(2, np.int64),
        window_begun=np.zeros(groups, np.int64),
        window_matrix=np.zeros((p, p)),
        window_mean=np.zeros(p),
        window_noise=np.zeros(p),
        window_white=np.zeros(p),
        window_vague=np.zeros(p),
        window_factor=np.zeros((p, p)),
        window_square=np.zeros(p),
        window_row=np.zeros(p),
        window_left=np.zeros(p),
        window_change=np.zeros(p),
        ramps=np.zeros((groups, len(s.ramp_lengths), p, m)),
        ramp_samples=np.zeros(groups, np.int64),
        sensitivity=np.zeros((groups, effectors, p, m)),
        cross=np.zeros((rows, effectors)),
        unexplained=np.zeros(effectors),
        unlike=np.zeros((2, rows, effectors)),
        late_square=np.zeros((2, rows, p)),
    )


def _noise(s: BankSettings, rows: int) -> dict[str, Any]:
    """Allocate noise in deflections, states and outputs, and what it takes from estimates."""
    p = s.prior.shape[0]
    effectors = s.effectors_to - s.effectors_from
    lags = 2 * s.late + 1 if s.straddle == 0 else 1
    return dict(
        deflections=np.zeros((3, effectors)),
        quantum=np.zeros((6, effectors)),
        recorded=np.zeros((2, effectors)),
        third_median=np.zeros(effectors),
        third_floor=np.zeros(effectors),
        white_past=np.zeros((3, effectors)),
        white_median=np.zeros(effectors),
        timing=np.zeros(rows),
        white_errors=np.zeros((rows, lags)),
        whites=np.zeros((s.late + 1, effectors)),
        white_cross=np.zeros((rows, effectors, lags)),
        white_factor=np.zeros((lags, lags)),
        white_solved=np.zeros(lags),
        white_parts=np.zeros((2, lags)),
        white_power=np.zeros((rows, effectors)),
        white_answered=np.zeros((rows, effectors)),
        past_outputs=np.zeros((max(s.straddle, 1), rows)),
        common=np.zeros((3, rows, effectors)),
        rest_cross=np.zeros((rows, effectors, lags)),
        rest_power=np.zeros((rows, effectors)),
        rest_square=np.zeros((rows, effectors)),
        rest_energy=np.zeros(effectors),
        rest_evidence=np.zeros((2, effectors)),
        dithered=np.zeros(effectors),
        rested=np.zeros(effectors),
        rest=np.zeros(1, np.int64),
        suspected=np.zeros(effectors, np.int64),
        unanswered=np.zeros(effectors),
        states=np.zeros((3, rows)),
        state_third=np.zeros(rows),
        entry=np.zeros((rows, rows)),
        entry_samples=np.zeros(rows),
        state_median=np.zeros(rows),
        measured=np.zeros(rows),
        white_states=np.zeros(rows),
        left_late=np.zeros(rows),
        white_noise=np.zeros(rows),
        third_noise=np.zeros(effectors),
        answered=np.zeros(effectors, np.int64),
        effect=np.zeros((rows, effectors)),
        widened=np.ones((rows, p)),
        unlearnt=np.zeros((rows, p)),
        correction=np.zeros((rows, p)),
        best_correction=np.zeros((rows, p)),
        speed_logarithm=np.zeros((2, p)),
        pulled=np.zeros(p),
        vague=np.zeros(p),
        since_best=np.zeros(p),
        columns=np.zeros((p, p)),
        removed=np.zeros(p),
        corrected=np.zeros(p),
        uncorrected=np.zeros(p),
    )


def _losses(s: BankSettings, rows: int, groups: int) -> dict[str, Any]:
    """Allocate what is kept through an alarm, and what losses of surfaces are looked for in."""
    p = s.prior.shape[0]
    kept = int(max(s.loss_delays, default=0)) + 1
    return dict(
        carried=np.full((rows, p), np.inf),
        pending=np.zeros(rows, np.int64),
        theta_before=np.zeros((rows, p)),
        square_before=np.zeros((rows, p)),
        kept=np.zeros(2, np.int64),
        last_phi=np.zeros((s.persistence, p)),
        last_y=np.zeros((s.persistence, rows)),
        kept_theta=np.zeros((kept, rows, p)),
        kept_square=np.zeros((kept, rows, p)),
        innovation=np.zeros((len(s.loss_members), rows, 5)),
        innovation_sums=np.zeros((rows, 2 ** (s.loss_sums - 1) + 1)),
        sums_taken=np.zeros(rows, np.int64),
        sum_squares=np.zeros((rows, s.loss_sums, 2)),
        whitened=np.zeros((groups, len(s.loss_members), max(s.straddle, 1), p)),
        motion=np.zeros((groups, len(s.loss_members), 2, p)),
        run=np.zeros((len(s.loss_members), 2), np.int64),
        suspect=np.zeros(len(s.loss_members), np.int64),
        calm=np.zeros(len(s.loss_members), np.int64),
    )


def _errors(s: BankSettings, rows: int, groups: int) -> dict[str, Any]:
    """Allocate counts of samples, what estimates are known to, and where they were known best."""
    p = s.prior.shape[0]
    return dict(
        misfits=np.zeros(rows, np.int64),
        samples=np.zeros(1, np.int64),
        learning=np.zeros(1, np.int64),
        waits=np.zeros(1, np.int64),
        held_statistic=np.zeros(rows),
        alert=np.zeros(1, np.int64),
        waiting=np.zeros(groups, np.int64),
        square=np.zeros((rows, p)),
        square_lately=np.zeros((2, rows, p)),
        batch=np.zeros((len(s.batches), rows, p, 3)),
        batch_kept=np.zeros((len(s.batches), rows)),
        batch_number=np.zeros((len(s.batches), rows), np.int64),
        lately=np.zeros(rows, np.int64),
        best=np.zeros((rows, p)),
        best_square=np.zeros((rows, p)),
        best_time=np.zeros((rows, p)),
        best_place=np.zeros((rows, p, len(s.velocities) + len(s.rates) + 1)),
        shift=np.zeros((rows, p)),
        drawn=np.zeros(rows, np.int64),
        place=np.zeros(len(s.velocities) + len(s.rates) + 1),
        speed=np.zeros(2),
        seen=np.zeros(p),
        apart=np.zeros(1, np.int64),
        clock=np.zeros(2),
    )


def clear_bank(s: BankSettings, x: BankState) -> None:
    """Start anew: nothing known, estimates zero, all rows in group 0."""
    for array in x:
        array[...] = 0
    mixes = s.mixes[: len(x.weight)]
    x.weight[:] = mixes / mixes.sum(axis=1, keepdims=True)
    x.known[:] = 1.0
    x.widened[:] = 1.0
    x.unlearnt[:] = 0.0
    x.gust_effect[:] = math.inf
    x.carried[:] = math.inf
    x.energy_share[:] = 1.0
    x.e[:] = math.nan
    x.best_square[:] = math.inf
    x.square[:] = math.inf
    x.square_moved[:] = math.inf
    x.square_hidden[:] = 0.0
    x.square_past[:] = math.inf
    x.counted[:] = -s.rest
    clear_factors(s, x, 0)


@compiled
def clear_factors(s: BankSettings, x: BankState, g: int) -> None:
    """Put the priors in the place of all factors of group g."""
    for m in range(s.forgetting.shape[0]):
        clear_factor(s, x, g, m)
    for i in range(s.prior.shape[0]):
        x.kept_info[g, i] = 0.0
        for j in range(x.sensitivity.shape[1]):
            for m in range(s.forgetting.shape[0]):
                x.sensitivity[g, j, i, m] = 0.0
    x.age[g] = 0
    begin_ramps(x, g)
    for a in range(x.motion.shape[1]):
        for i in range(s.prior.shape[0]):
            x.motion[g, a, 0, i] = 0.0
            x.motion[g, a, 1, i] = 0.0
    for a in range(x.axis_gate.shape[1]):
        x.axis_gate[g, a] = 1.0


@compiled
def clear_factor(s: BankSettings, x: BankState, g: int, m: int) -> None:
    """Put the prior in the place of one factor."""
    p = s.prior.shape[0]
    for i in range(p):
        for k in range(p):
            x.R[g, i, k, m] = 0.0
        x.R[g, i, i, m] = s.prior[i, m]
        x.info[g, i, m] = s.prior[i, m] * s.prior[i, m]
    x.taken[g, m] = 0.0
    for q in range(x.noisy.shape[1]):
        x.noisy[g, q, m] = 0.0
        x.noisy_white[g, q, m] = 0.0
