"""A dither law on its own: what is known of an aircraft's B, stamps of many kinds, and a true first-order actuator."""

from __future__ import annotations

import itertools
import math

import numpy as np

from msls_ros.estimation import Configuration, DitherBlock, DitherLaw, from_mapping
from msls_ros.estimation.dither.inputs import Knowledge
from msls_ros.estimation.kernel import Array

M = 7
LIMITED = {
    "dither.actuator_bandwidth": [20.0] * M,
    "dither.rate_limit": [1.0, 2.0, 1.0, 1.4, 1.4, 0.8, 0.8],
    "dither.position_low": [-0.4] * M,
    "dither.position_high": [0.4] * M,
    "dither.acceleration": "rms",
    "dither.allocation": "information",
}
LITERAL = {"acceleration": "worst_case", "allocation": "equal"}
ROWS = np.arange(6)


def law(**changes: object) -> tuple[DitherLaw, Configuration]:
    configuration = from_mapping({**LIMITED, **{f"dither.{k}": v for k, v in changes.items()}})
    return DitherLaw(configuration), configuration


def known(n: int, b: Array, std: float = 0.0, excitation: float = 1.0, alarms: tuple[int, ...] = ()) -> Knowledge:
    """Return what is known of B (6, m) at n samples; ``std`` is relative to each entry."""
    alarm = np.zeros((n, 6), np.int64)
    alarm[list(alarms), 3] = 1
    m = b.shape[1]
    with np.errstate(all="ignore"):
        square = np.square(std * b)
    variance = square if math.isfinite(std) else np.full(b.shape, math.inf)
    nothing = np.full((n, b.shape[0], 1), math.nan)
    return Knowledge(np.tile(b, (n, 1, 1)), np.tile(variance, (n, 1, 1)), np.full((n, m), excitation), alarm, nothing)


def at(knowledge: Knowledge, k: int) -> Knowledge:
    """Return what is known at sample k alone."""
    x, one = knowledge, slice(k, k + 1)
    return Knowledge(x.b[one], x.variance[one], x.excitation[one], x.alarm[one], x.output[one])


def clock(n: int, step: float = 0.02) -> Array:
    return step * np.arange(n, dtype=np.float64)


def drive(dither: DitherLaw, knowledge: Knowledge, step: float = 0.02) -> DitherBlock:
    n, _, m = knowledge.b.shape
    return dither.commands(clock(n, step), knowledge, np.zeros((n, m)))


def aircraft(seed: int = 0, m: int = M) -> Array:
    """Return a B (6, m) of the size of a real one."""
    scale = np.array([1.0, 3.0, 8.0, 3.0, 1.5, 1.0])[:, None]
    return scale * np.random.default_rng(seed).standard_normal((6, m))


def accelerations(b: Array, surfaces: Array, c: Configuration) -> Array:
    """Return the acceleration (n, 3) at the pilot by the surfaces (n, m) [m/s^2] (eq 20), written out anew."""
    u, v, w, p, q, r = b @ surfaces.T
    ahead, above, right = c.dither.pilot_forward, c.dither.pilot_above, c.dither.pilot_right
    arm = np.array([ahead, right, -above])
    return np.stack([u, v, w], axis=1) + np.cross(np.stack([p, q, r], axis=1), arm)


def true_surfaces(time: Array, commands: Array, corner: float, hold: float) -> tuple[Array, Array, Array]:
    """Return share of the surface, rate just after each command, and share in fine steps, of a first-order actuator."""
    surface = np.zeros(commands.shape[1])
    shares, rates, fine = [], [], []
    for k, command in enumerate(commands):
        shares.append(surface)
        rates.append(corner * (command - surface))
        dt = time[k + 1] - time[k] if k + 1 < len(time) else 0.0
        for part in np.linspace(0.0, min(dt, hold), 9)[1:]:
            fine.append(command + (surface - command) * math.exp(-corner * part))
        surface = command + (surface - command) * math.exp(-corner * min(dt, hold))
        surface = surface * math.exp(-corner * max(dt - hold, 0.0))
    return np.array(shares), np.array(rates), np.array(fine)


STAMPS = {
    "even": [0.02],
    "jitter": [0.005, 0.035, 0.012, 0.028, 0.02],
    "lost": [0.02, 0.02, 0.04, 0.02, 0.06, 0.02, 0.02],
    "double rate": [0.01],
    "half rate": [0.04],
    "11 Hz": [1.0 / 11.0],
    "1 kHz": [0.001],
    "bursts": [0.001, 0.001, 0.001, 0.077],
    "gaps": [0.02] * 30 + [0.5],
    "silence": [0.02] * 40 + [3.0],
}


def stamped(kind: str, n: int, seed: int) -> Array:
    steps = np.array(list(itertools.islice(itertools.cycle(STAMPS[kind]), n)))
    rng = np.random.default_rng(seed)
    if kind in ("jitter", "lost"):
        rng.shuffle(steps)
    return np.concatenate([[0.0], np.cumsum(steps)[:-1]])
