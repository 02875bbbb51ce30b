"""Why to believe a model: how well it predicts the next sample, and whether least squares over the span agrees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation import Configuration
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.settings import bank_settings
from msls_ros.estimation.bank.speed import FASTEST, SLOWEST, power_of, raise_regressors, speed_of, value_at
from msls_ros.estimation.kinematics import build_regression, find_forces, find_rotation, find_states
from msls_ros.offline.recompute import Recomputed
from msls_ros.report.knowledge import gather_knowledge
from msls_ros.report.recorded import Equation, Event, Models, Trust

Array = NDArray[np.float64]
_LAGS = 20
_FIRST = 3
"""Memory of the start that is left out, in samples per regressor."""
_SHOWN = 6000
_BAND = 1.96


def trust_of(
    configuration: Configuration | None,
    computed: Recomputed | None,
    models: Models | None,
    alarms: Sequence[Event],
    origin: int,
) -> Trust | None:
    """Return how well a flight is predicted; None where it was not identified again.

    Parameters
    ----------
    configuration
        Of the identifier.
    computed
        What came of the inputs.
    models
        Recorded or computed.
    alarms
        Events of detection.
    origin
        Stamp of flight time 0 [ns].
    """
    if configuration is None or computed is None or models is None or not computed.samples:
        return None
    x, xdot, delta = (np.concatenate(parts) for parts in zip(*computed.samples, strict=True))
    time = np.array([(stamp - origin) * 1e-9 for stamp, _ in computed.signals])
    if len(time) != len(x) or np.any(np.diff(time) <= 0.0):
        return None
    phi, y = regression(configuration, x, xdot, delta, turning=False)
    error = np.array([e for _, (e, _) in computed.signals])
    start = _FIRST * phi.shape[1]
    if len(time) < 2 * start:
        return None
    step = max(1, -(-len(time) // _SHOWN))
    equations = [
        _equation(name, time[start:], y[start:, q], error[start:, q], step) for q, name in enumerate(configuration.rows)
    ]
    span = _longest(time, alarms, start * float(np.median(np.diff(time))))
    chosen = (time >= span[0]) & (time < span[1])
    if chosen.sum() < start:
        return Trust(equations)
    sample = x[chosen], xdot[chosen], delta[chosen]
    inside, compared = _agreement(configuration, _within(models, span), time[chosen], *sample)
    return Trust(equations, (float(time[chosen][0]), float(time[chosen][-1])), inside, compared)


def _longest(time: Array, alarms: Sequence[Event], settling: float) -> tuple[float, float]:
    """Return the longest span without an alarm, the settling after one left out [s]."""
    times = [e.time for e in alarms]
    starts, ends = [float(time[0]), *(t + settling for t in times)], [*times, float(time[-1]) + 1e-6]
    return max(zip(starts, ends, strict=True), key=lambda span: span[1] - span[0])


def _within(models: Models, span: tuple[float, float]) -> Models | None:
    """Return the models of a span; None: there are none."""
    inside = (models.time >= span[0]) & (models.time < span[1])
    if not inside.any():
        return None
    names = ("time", "a", "b", "a_std", "b_std", "a_reliable", "b_reliable", "excitation", "residual_std")
    return replace(models, **{name: getattr(models, name)[inside] for name in names})


def regression(
    configuration: Configuration, x: Array, xdot: Array, delta: Array, *, turning: bool
) -> tuple[Array, Array]:
    """Return regressors (k, p) and outputs (k, r) as the identifier has them; rotation is taken off where asked for."""
    c = configuration
    kept = np.array([c.states.index(name) for name in c.rows], np.int64)
    phi, y = np.empty((len(x), len(c.regressors))), np.empty((len(x), len(kept)))
    forces, states = find_forces(c.rows, c.known_gravity), find_states(c.states)
    build_regression(x, xdot, delta, kept, forces, states, turning, phi, y)
    return phi, y


def _equation(name: str, time: Array, y: Array, error: Array, step: int) -> Equation:
    spread = float(np.var(y))
    r2 = 1.0 - float(np.mean(np.square(error))) / spread if spread > 0.0 else 0.0
    centred = error - error.mean()
    power = float(np.sum(centred * centred))
    k = len(centred)
    products = [np.sum(centred[:-n] * centred[n:]) for n in range(1, min(_LAGS, k - 1) + 1)]
    lags = [float(product) / power if power > 0.0 else 1.0 for product in products]
    white = float(np.mean(np.abs(lags) < _BAND / np.sqrt(k)))
    return Equation(name, time[::step], y[::step], (y - error)[::step], r2, white, spread > 0.0)


def _agreement(
    configuration: Configuration, models: Models | None, time: Array, x: Array, xdot: Array, delta: Array
) -> tuple[int, int]:
    """Return how many of the numbers known in the span agree with least squares over it, and how many those are."""
    if models is None:
        return 0, 0
    phi, y = regression(configuration, x, xdot, delta, turning=configuration.known_rotation)
    settings = bank_settings(configuration) if configuration.estimator.method == "bank" else None
    ratio = _scale_by_speed(settings, phi) if settings is not None and settings.scaled else np.ones(len(phi))
    scale = np.sqrt(np.mean(np.square(phi), axis=0))
    moving = scale > 0.0
    scaled = phi[:, moving] / scale[moving]
    information = scaled.T @ scaled
    if np.linalg.cond(information) > 1e12:
        return 0, 0
    inverse = np.linalg.inv(information)
    theta = inverse @ (scaled.T @ y)
    left = y - scaled @ theta
    rho = np.sum(left[1:] * left[:-1], axis=0) / np.maximum(np.sum(left * left, axis=0), 1e-300)
    colour = (1.0 + np.clip(rho, 0.0, 0.98)) / (1.0 - np.clip(rho, 0.0, 0.98))
    variance = np.sum(left * left, axis=0) / max(1, len(y) - len(theta)) * colour
    std = np.sqrt(np.diag(inverse)[:, None] * variance[None, :]) / scale[moving][:, None]
    whole = np.zeros((phi.shape[1], y.shape[1]))
    whole[moving] = theta / scale[moving][:, None]
    names = [name for name, used in zip(configuration.regressors, moving, strict=True) if used]
    known = gather_knowledge(models, [])
    parts = find_rotation(configuration.rows) if configuration.known_rotation else {}
    inside = compared = 0
    for i, j in np.argwhere(known.known).tolist():
        row, column = known.rows[i], known.columns[j]
        if row in configuration.rows and column in names:
            q, p = configuration.rows.index(row), configuration.regressors.index(column)
            value = float(known.value[i, j])
            at = min(int(np.searchsorted(time, known.time[i, j])), len(time) - 1)
            if (q, p) in parts:
                source, factor = parts[q, p]
                value -= factor * float(x[at, configuration.states.index(configuration.rows[source])])
            expected, power = float(whole[p, q]), 1.0
            if settings is not None:
                now = np.roll(phi[at], 1)
                expected = value_at(settings, np.roll(whole[:, q], 1), now, p + 1, float(ratio[at]))
                power = power_of(settings, p + 1, float(ratio[at]))
            compared += 1
            own = power * float(std[names.index(column), q])
            inside += abs(value - expected) <= _BAND * float(np.hypot(known.std[i, j], own))
    return inside, compared


def _scale_by_speed(settings: BankSettings, phi: Array) -> Array:
    """Scale regressors (k, p), constant last, as the bank does, by the speed of the first; return the ratios (k,)."""
    speeds = [speed_of(settings, np.roll(row, 1)) for row in phi]
    ratios = np.clip(np.array(speeds) / max(speeds[0], 1e-9), SLOWEST, FASTEST)
    for row, ratio in zip(phi, ratios.tolist(), strict=True):
        scaled = np.roll(row, 1)
        raise_regressors(settings, scaled, ratio)
        row[:] = np.roll(scaled, -1)
    return ratios
