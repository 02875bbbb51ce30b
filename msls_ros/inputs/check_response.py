"""How long after a surface the aircraft answers, and whether measured derivatives belong to their states."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from msls_ros.estimation.kernel import Array
from msls_ros.inputs.check_effectors import effectors_of
from msls_ros.inputs.findings import DOUBTFUL, NOTE, WRONG, Finding
from msls_ros.inputs.frames import BODY
from msls_ros.inputs.motion import misfit, windowed
from msls_ros.inputs.series import Record, Series, on_grid

_STEP = 0.01
_WINDOW = 0.06
"""Over which the rates are differenced [s]."""
_LATEST = 0.25
"""Delays looked for [s]."""
_WORTH = 0.02
"""Delay worth naming [s]."""
_MOST = 20000
_GAIN = 0.08
"""Share of the residual that the delay must explain."""
_SURE = 0.5
"""Share from which it is sure: a law that answers a fault nobody measures gave 0.38, real delays give 0.65 and more."""
_MEANT = {"de": 1, "elevator": 1, "da": 0, "aileron": 0, "ailerons": 0, "dr": 2, "rudder": 2}
"""Axis that a surface of this name turns the aircraft about: roll, pitch, yaw."""
_OTHER = 6.0
"""It turns it about another so many times as much, for the names to be exchanged."""
_MOST_POWER = 1000.0
"""Angular acceleration per deflection beyond that of any aircraft [rad/s^2 per rad]."""
_UNRELATED, _TURNS = 1.4, 0.1
"""Misfit from which a derivative is none of its rate's, where that changes by so much over 0.4 s [rad/s^2, rms]."""
_FACTORS = {"-1": -1.0, "0.0174533": np.pi / 180.0, "57.2958": 180.0 / np.pi, "9.80665": 9.80665, "0.101972": 0.101972}


def check_response(record: Record) -> Iterator[Finding]:
    """Yield the delay from the surfaces to the angular accelerations, where it is not what the map says."""
    rates = [n for n in ("angular_velocity", "states.P", "states.Q", "states.R") if n in record.series]
    surfaces = {n: s for n, s in effectors_of(record).items() if np.ptp(s.values) > 0.0 and not s.stream.track.held}
    if not rates or not surfaces:
        return
    chosen: dict[str, Series] = {n: record.series[n] for n in rates}
    chosen.update((f"effectors.{n}", s) for n, s in surfaces.items())
    if any(len(s.stamps) < 50 for s in chosen.values()):
        return
    slowest = max(float(np.median(np.diff(s.stamps))) * 1e-9 for s in chosen.values())
    grid = on_grid(chosen, max(_STEP, 0.25 * slowest), _MOST)
    if grid is None:
        return
    step = float(grid[0][1])
    turn = np.concatenate([grid[1][n] for n in rates], axis=1)
    delta = np.concatenate([grid[1][f"effectors.{n}"] for n in surfaces], axis=1)
    lags, scores = _residuals(turn, delta, step)
    best, none = int(np.argmin(scores)), int(np.argmin(np.abs(lags)))
    gain = 1.0 - scores[best] / scores[none] if scores[none] > 0.0 else 0.0
    lag = float(lags[best])
    where = "inputs.effectors"
    if turn.shape[1] == 3 and scores[best] < 0.5:
        signs = np.array(BODY[chosen[rates[0]].stream.body or "frd"]) if len(rates) == 1 else np.ones(3)
        yield from _names(list(surfaces), *_effects(turn * signs, delta, step, round(lag / step)), delta.std(axis=0))
    if scores[best] > 0.9:
        yield Finding(NOTE, "response", where, "the surfaces explain less than a tenth of the angular accelerations")
    elif gain < _GAIN or abs(lag) < max(_WORTH, step):
        yield Finding(NOTE, "delay", where, f"the aircraft answers the surfaces as the map says, within {_WORTH:g} s")
    else:
        word = "after" if lag > 0.0 else "before"
        what = f"the aircraft answers {1e3 * abs(lag):.0f} ms {word} the surfaces as mapped: B is wrong by it"
        level = WRONG if gain > _SURE else DOUBTFUL
        yield Finding(level, "delay", where, what, f"delay smaller by {lag:.3f} s in the topic's line")


def _residuals(turn: Array, delta: Array, step: float) -> tuple[Array, Array]:
    """Return delays (l,) [s] and the share (l,) of the angular accelerations that is left unexplained."""
    width = max(2, round(_WINDOW / step))
    most = max(1, round(_LATEST / step))
    slope = (turn[width:] - turn[:-width]) / (width * step)
    states, held = windowed(turn, width), windowed(delta, width)
    inner = slice(most, len(slope) - most)
    y = slope[inner] - slope[inner].mean(axis=0)
    scale = np.square(y).sum(axis=0)
    lags, scores = [], []
    for steps in range(-most, most + 1):
        own = held[most - steps : len(held) - most - steps]
        x = np.column_stack([states[inner], own])
        x -= x.mean(axis=0)
        gram, side = x.T @ x, x.T @ y  # one pass over the samples; the residual needs no better conditioning
        weights, *_ = np.linalg.lstsq(gram, side, rcond=1e-12)
        left = scale - (weights * (2.0 * side - gram @ weights)).sum(axis=0)
        lags.append(steps * step)
        scores.append(float(np.mean(left / np.where(scale > 0.0, scale, 1.0))))
    return np.array(lags), np.array(scores)


def _effects(turn: Array, delta: Array, step: float, steps: int) -> tuple[Array, Array]:
    """Return what each surface turns the aircraft by, rms (m, 3) [rad/s^2], and the rms of what is left (3,)."""
    width, most = max(2, round(_WINDOW / step)), max(1, round(_LATEST / step))
    slope = (turn[width:] - turn[:-width]) / (width * step)
    states, held = windowed(turn, width), windowed(delta, width)
    own = held[most - steps : len(held) - most - steps]
    x = np.column_stack([own, states[most : len(slope) - most], np.ones(len(own))])
    y = slope[most : len(slope) - most]
    weights, *_ = np.linalg.lstsq(x, y, rcond=None)
    return np.abs(weights[: own.shape[1]]) * own.std(axis=0)[:, None], np.asarray((y - x @ weights).std(axis=0))


def _names(names: list[str], effects: Array, left: Array, moved: Array) -> Iterator[Finding]:
    """Yield surfaces that turn the aircraft about another axis than one of their name does, or more than any can."""
    for name, effect, rms in zip(names, effects, moved, strict=True):
        power = float(effect.max() / rms)
        if power > _MOST_POWER and effect.max() > 2.0 * left[int(np.argmax(effect))]:
            what = f"would turn the aircraft by {power:.0f} rad/s^2 per rad: it moves further than the map says"
            mend = "a larger scale: 57.3 times, where radians were taken for degrees"
            yield Finding(WRONG, "units", f"inputs.effectors.{name}", what, mend)
        meant = _MEANT.get(name.lower())
        if meant is None:
            continue
        most = int(np.argmax(effect))
        about = {0: "roll", 1: "pitch", 2: "yaw"}
        rivals = {1} if meant != 1 else {0, 2}  # ailerons yaw, and rudders roll, the aircraft as well
        if most in rivals and effect[most] > _OTHER * effect[meant] and effect[most] > 2.0 * left[most]:
            what = f"turns the aircraft in {about[most]}, hardly in {about[meant]}: the channel of another surface?"
            mend = f"map the one that drives {name}; where this is it, give it another name"
            yield Finding(WRONG, "names", f"inputs.effectors.{name}", what, mend)


def check_derivatives(record: Record) -> Iterator[Finding]:
    """Yield measured derivatives that are not those of their states, with the factor that makes them so."""
    pairs = [
        (name, f"states.{name.removeprefix('derivatives.')}")
        for name in record.series
        if name.startswith("derivatives.")
    ]
    if "angular_acceleration" in record.series:
        pairs.append(("angular_acceleration", "angular_velocity"))
    for derivative, state in pairs:
        if state in record.series and min(len(record.series[n].stamps) for n in (derivative, state)) > 50:
            yield from _check_derivative(record, derivative, state)


def _check_derivative(record: Record, derivative: str, state: str) -> Iterator[Finding]:
    pair = {n: record.series[n] for n in (derivative, state)}
    slowest = max(float(np.median(np.diff(s.stamps))) * 1e-9 for s in pair.values())
    grid = on_grid(pair, max(_STEP, slowest), _MOST)
    if grid is None:
        return
    step = float(grid[0][1])
    signs = [np.array(BODY[pair[n].stream.body or "frd"]) if pair[n].values.shape[1] == 3 else np.ones(1) for n in pair]
    given, values = (grid[1][n] * s for n, s in zip((derivative, state), signs, strict=True))
    sides = []
    for window in (0.1, 0.4):
        width = max(1, round(window / step))
        slope = (values[width:] - values[:-width]) / (width * step)
        measured = windowed(given, width)
        sides.append((slope - slope.mean(axis=0), measured - measured.mean(axis=0)))
    now, long = (misfit(*side) for side in sides)
    slope, measured = sides[0]
    if now < 0.8 or slope.std() < 1e-6:
        return
    where, leaf = f"inputs.{derivative}", state.rpartition(".")[2]
    what = f"is not the derivative of {leaf} (misfit {now:.2g}; 0 agrees, 2 unrelated, 4 opposite)"
    for word, factor in _FACTORS.items():
        if misfit(slope, factor * measured) < min(0.4, 0.4 * now):
            yield Finding(WRONG, "derivative", where, what, f"scale={word}")
            return
    if slope.shape[1] == 3 and misfit(slope, measured * BODY["flu"]) < 0.4:
        yield Finding(WRONG, "derivative", where, what, "the other frame, flu or frd")
        return
    unrelated = leaf in (*"PQR", "angular_velocity") and float(sides[1][0].std()) > _TURNS
    level = WRONG if unrelated and min(now, long) > _UNRELATED else DOUBTFUL
    yield Finding(level, "derivative", where, what, "map what is; or leave it out, so that the state is differentiated")
