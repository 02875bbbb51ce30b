"""Surfaces that cannot be told apart: the loss of one alarms, names neither, and makes what is known of both open."""

from __future__ import annotations

import numpy as np

from msls_ros.estimation import EventKind, Identifier, Run, from_mapping

RATE = 50
LOST = 16.0
"""When half of the outer aileron is lost [s]."""


def fly(seed: int, *, left: float = 0.5, apart: bool = False) -> Run:
    """Return what is said of an aircraft that rolls by an inner and an outer aileron.

    They are learnt one by one until 9 s, and then move together, but where the pilot moves the outer one ``apart``
    from 18 s on. ``left`` is what is left of its effect from `LOST` on [1].
    """
    random = np.random.default_rng(seed)
    count, steps = 22 * RATE, 4
    dt = 1.0 / (RATE * steps)
    p, ailerons, rows = 0.0, np.zeros(2), []
    for k in range(count * steps):
        t = k * dt
        doublet = [0.04 * ((b <= t < b + 0.6) - 1.0 * (b + 0.6 <= t < b + 1.2)) for b in (3.0, 6.0)]
        both = 0.04 * np.sign(np.sin(4.0 * t)) if t >= 9.0 else 0.0
        wanted = np.array([doublet[0] + both, doublet[1] + 0.7 * both])
        if apart and t >= 18.0:
            wanted[1] = 0.04 * np.sign(np.cos(3.0 * t))
        slope = -2.0 * p + 12.0 * ailerons[0] + 8.0 * (left if t >= LOST else 1.0) * ailerons[1]
        if k % steps == 0:
            rows.append((p, slope, *ailerons))
        p += dt * slope
        ailerons += dt * 25.0 * (wanted - ailerons)
    data = np.array(rows) + random.normal(size=(count, 4)) * np.deg2rad([0.05, 0.25, 0.02, 0.02])
    c = from_mapping(
        {"states": ("P",), "effectors": ("inner", "outer"), "known_gravity": False, "sample_rate": float(RATE)}
    )
    return Identifier(c).run(np.arange(count) / RATE, data[:, :1], data[:, 1:2], data[:, 2:], every=5)


def times(run: Run, kind: EventKind) -> list[float]:
    """Return when events of a kind came [s]."""
    return [event.time for one in run.estimates for event in one.events if event.kind == kind]


def test_a_loss_that_two_explain_alike_alarms_names_none_and_leaves_neither_known() -> None:
    for seed in (1, 3, 6):
        run = fly(seed)
        alarms = times(run, EventKind.DETECTED)
        assert LOST < alarms[0] < LOST + 2.0 and not times(run, EventKind.ISOLATED)
        after = [one for one in run.estimates if alarms[0] < one.time < alarms[0] + 1.0]
        assert not any(one.b_reliable.any() for one in after)


def test_they_are_named_rightly_once_they_move_apart() -> None:
    for seed in range(1, 7):
        events = [event for one in fly(seed, apart=True).estimates for event in one.events]
        assert [event.suspected_effector for event in events if event.kind == EventKind.ISOLATED] == ["outer"]


def test_the_sum_that_has_changed_is_not_laid_to_one_of_them() -> None:
    """What is published of either holds what is left, whichever of them the estimates have moved."""
    for seed in range(1, 7):
        said = [one for one in fly(seed).estimates if one.time > LOST + 1.5 and one.b_reliable.any()]
        off = [
            abs(one.b[0, j] - true) / one.b_std[0, j]
            for one in said
            for j, true in enumerate((12.0, 4.0))
            if one.b_reliable[0, j]
        ]
        assert max(off, default=0.0) < 3.0


def test_intact_ones_that_move_together_stay_known() -> None:
    kept = 0
    for seed in range(1, 9):
        run = fly(seed, left=1.0)
        assert not times(run, EventKind.DETECTED)
        known = [one.b_std[0] < 0.5 for one in run.estimates if one.time > 10.0]
        kept += bool(np.mean(known, axis=0).min() > 0.9)
    assert kept >= 7
