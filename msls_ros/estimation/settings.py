"""From the parameters that people set to the numbers that the compiled loop takes."""

from __future__ import annotations

import math

import numpy as np

from msls_ros.estimation.configuration import Configuration
from msls_ros.estimation.state import COLOURS, PRIOR_MSLS, PRIOR_RLS, Settings


def loop_settings(c: Configuration) -> Settings:
    """Translate the parameters into what the compiled loop takes."""
    e, d, p = c.estimator, c.detector, len(c.regressors)
    rls, reliability = e.method == "rls", c.reliability
    penalty = np.full(p, e.penalty) * np.array(e.penalty_factors or (1.0,) * p)
    if e.penalty_constant > 0.0:
        penalty[p - 1] = e.penalty_constant
    forgetting = c.forgetting
    merge = math.ceil(math.log(c.recovery.rejoin_tolerance) / math.log(forgetting)) if forgetting < 1.0 else -1
    reference = min(reliability.reference_memory / max(1.0 - forgetting, 1e-9), reliability.colour_memory)
    confounding = np.repeat(
        [reliability.confounding_states**2, reliability.confounding_effectors**2, 0.0],
        [len(c.rows), len(c.effectors), 1],
    )
    return Settings(
        rls=rls,
        retained=e.penalty_retained,
        forgetting=forgetting,
        penalty=penalty,
        scale=np.array([c.reference_speed if s in ("u", "v", "w") else 1.0 for s in c.regressors]),
        auto_scale=e.scale == "auto",
        rms_memory=e.rms_memory,
        colours=np.array(COLOURS if reliability.coloured else COLOURS[:1]),
        residual_forgetting=1.0 - 1.0 / reliability.residual_memory,
        colour_forgetting=1.0 - 1.0 / reliability.colour_memory,
        prior=PRIOR_RLS if rls else PRIOR_MSLS,
        detect=d.mode != "off" and not rls,
        normalised=d.mode == "normalised",
        window=d.window,
        short=d.short if d.mode == "ratio" else 1,
        threshold=d.threshold + (0.0 if d.mode == "ratio" else 1.0),
        floor_absolute=np.array(d.floor_absolute or (0.0,) * len(c.rows)),
        floor_relative=d.floor_relative,
        floor_model=d.floor_model,
        hold_off=d.hold_off,
        ease_start=c.recovery.at_start,
        recovery_penalty=c.recovery.penalty_factor,
        recovery_forgetting=c.recovery.forgetting_factor or forgetting,
        merge_after=merge,
        effectors_from=len(c.rows),
        effectors_to=len(c.rows) + len(c.effectors),
        confounded=bool(confounding.any()) and forgetting < 1.0,
        reference_forgetting=1.0 - (1.0 - forgetting) / reliability.reference_memory,
        deviation_forgetting=max(1.0 - p / (reliability.colour_memory * len(c.rows)), 0.0),
        watch=4 * p + math.ceil(reference),
        confounding=confounding,
        followed_row=-1,
        followed_column=-1,
        horizon=(1.0 + forgetting) / (1.0 - forgetting) if forgetting < 1.0 else math.inf,
    )
