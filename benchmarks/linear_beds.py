"""Made-up linear aircraft: hundreds of them in minutes, each with effects, inputs, noise, air, servos of its own.

What every bed of `calibration_beds` has in common, that it is JSBSim's, these do not: A and B are drawn anew for each
flight, lateral (v, P, R by da, dr) or longitudinal (w, Q by de), at 15 to 200 m/s, and constant but for a loss of an
effector in half of the flights. Inputs are doublets, holds, 3-2-1-1, multisines or a pilot's, one effector after the
other with pauses; rates are fed back in half of the flights. Sensor noise is nothing to three times `NOISE`, gusts act
on the aircraft and are in no sensor, servos lag and are late, and deflections or commands are recorded. Each is
identified from measured derivatives, and with those of the rates made in a window, as `calibration_beds`. What records
of others do besides can be tried on the same flights (`RECORDS`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation import Configuration, Estimate, EventKind, Identifier, from_mapping
from msls_ros.inputs.derivatives import DerivativeFilter, usual_intervals

Array = NDArray[np.float64]
Row = dict[str, Any]
DURATION = 90.0
SUBSTEP = 0.0025
"""[s]"""
GUST_PACE, GUST = 1.5, 0.01
"""Corner of the gusts [rad/s]; their standard deviation at one, over speed [1]."""
NOISE = {"velocity": 0.01, "rate": 0.003, "acceleration": 0.1, "angular acceleration": 0.015, "deflection": 0.0005}
"""At one: over speed [1]; [rad/s, m/s^2], over the aircraft's frequency [rad/s], [rad]."""
SHAPES = ("doublets", "holds", "3-2-1-1", "multisine", "pilot")
LATE = 3.0
"""After a loss an alarm is one of it for so long, from then on that of what was not seen [s]."""
PATHS = ("direct", "differentiated")
RECORDS = ("as drawn", "coarse", "late", "slow", "held", "damped", "vane", "old velocity", "elevons")
"""As drawn; deflections recorded in steps of `COARSE`; `BEHIND` late; commands to servos of `SLOW`; deflections
measured for every `HELD` rows; dampers that are fed the measured rates, noise and all, and `REST` before an input; a
velocity that lags by `LAG`, or is that of `BEHIND` ago; aircraft that two elevons roll and pitch (`with_elevons`)."""
COARSE, BEHIND, SLOW, HELD = float(np.radians(0.1)), 0.02, 6.0, 3
"""[rad], [s] (a sample at least), [rad/s], [rows]"""
DAMPED, REST = 1.0, 20.0
"""Least gain of a damper, as `Linear.feedback` [1]; [s]."""
LAG = 0.05
"""Of a vane, first order [s]."""
PHASES = ("late", "1 s after", "1-4 s after", "loss not seen")


@dataclass(frozen=True)
class Linear:
    """A made-up aircraft and its flight; n states, m effectors."""

    states: tuple[str, ...]
    effectors: tuple[str, ...]
    a: Array
    b: Array
    rate: int
    """[Hz]"""
    speed: float
    pace: float
    """Of its modes, over those of an airliner [1]."""
    size: Array
    """(m,) of the inputs [rad]."""
    shape: str
    feedback: float
    noise: float
    gusts: float
    servo: float
    """Corner [rad/s]; 0: none."""
    delay: float
    commands: bool
    """Whether commands are recorded and not deflections."""
    lost: int
    """The effector that is lost at ``time``, negative: none."""
    left: float
    time: float
    damped: bool = False
    """Whether what is fed back has the noise that is recorded, after `REST`."""
    mix: Array | None = None
    """(m, m) what a pilot's commands, one for each rate, make of the effectors; None: an effector each."""


def draw(random: np.random.Generator) -> Linear:
    """Draw one."""
    rate, speed = int(random.choice([20, 25, 50, 100])), float(random.choice([15.0, 30.0, 80.0, 200.0]))
    pace = random.uniform(0.7, 1.6) * (2.0 if speed < 50.0 else 1.0)
    u, square = random.uniform, pace * pace
    states: tuple[str, ...]
    effectors: tuple[str, ...]
    if random.integers(2):
        states, effectors = ("v", "P", "R"), ("da", "dr")
        a = [
            [-0.3 * pace, 0.0, -speed],
            [-u(0.2, 2.0) * pace / speed, -u(1.5, 4.0) * pace, u(0.1, 1.0)],
            [u(1.0, 4.0) * square / speed, -u(0.0, 0.2), -u(0.2, 0.8) * pace],
        ]
        b = [[0.0, u(1.0, 6.0)], [u(5.0, 30.0) * square, u(0.0, 3.0)], [u(-1.0, 1.0), -u(2.0, 8.0) * square]]
    else:
        states, effectors = ("w", "Q"), ("de",)
        a = [[-u(0.5, 1.5) * pace, speed], [-u(1.0, 5.0) * square / speed, -u(0.7, 2.0) * pace]]
        b = [[-u(0.02, 0.15) * speed * pace], [-u(4.0, 15.0) * square]]
    m = len(effectors)
    return Linear(
        states,
        effectors,
        np.array(a),
        np.array(b),
        rate,
        speed,
        pace,
        u(0.02, 0.12, m),
        str(random.choice(SHAPES)),
        u(0.1, 0.5) if random.integers(2) else 0.0,
        float(random.choice([0.0, 0.1, 0.3, 1.0, 3.0])),
        float(random.choice([0.0, 0.0, 0.2, 1.0])),
        float(random.choice([0.0, 0.0, 20.0, 40.0])),
        float(random.choice([0.0, 0.0, 0.01, 0.03])),
        bool(random.integers(2)),
        int(random.integers(m)) if random.integers(2) else -1,
        float(random.choice([0.0, 0.3, 0.5])),
        u(50.0, 75.0),
    )


def with_elevons(one: Linear, random: np.random.Generator) -> Linear:
    """Return an aircraft of that pace and speed that two elevons pitch together and roll apart."""
    u, square = random.uniform, one.pace * one.pace
    a = [
        [-u(0.5, 1.5) * one.pace, one.speed, 0.0],
        [-u(1.0, 5.0) * square / one.speed, -u(0.7, 2.0) * one.pace, 0.0],
        [0.0, 0.0, -u(1.5, 4.0) * one.pace],
    ]
    lift, pitch, roll = -u(0.01, 0.08) * one.speed * one.pace, -u(2.0, 8.0) * square, u(3.0, 15.0) * square
    return replace(
        one,
        states=("w", "Q", "P"),
        effectors=("left", "right"),
        a=np.array(a),
        b=np.array([[lift, lift], [pitch, pitch], [roll, -roll]]),
        size=0.7 * u(0.02, 0.12, 2),
        lost=-1 if one.lost < 0 else int(random.integers(2)),
        mix=np.array([[1.0, 1.0], [1.0, -1.0]]),
    )


def inputs(one: Linear, random: np.random.Generator) -> Array:
    """Return the pilot's commands (n, m) [rad]: one effector after the other, with pauses."""
    n, dt = round(DURATION * one.rate), 1.0 / one.rate
    wanted = np.zeros((n, len(one.effectors)))
    start, length, turn = 3 * one.rate, round(random.uniform(3.0, 9.0) * one.rate), 0
    while start < n:
        j, turn = turn % len(one.effectors), turn + 1
        count = min(length, n - start)
        t, unit = dt * np.arange(count), random.uniform(0.3, 1.2)
        held = t < random.uniform(0.3, 0.8) * count * dt
        if one.shape == "doublets":
            shape = np.where(t < unit, 1.0, np.where(t < 2.0 * unit, -1.0, 0.0))
        elif one.shape == "holds":
            shape = held.astype(np.float64)
        elif one.shape == "3-2-1-1":
            shape = np.select([t < 3 * unit, t < 5 * unit, t < 6 * unit, t < 7 * unit], [1.0, -1.0, 1.0, -1.0], 0.0)
        elif one.shape == "multisine":
            tones = [np.sin(2 * np.pi * f * t + random.uniform(0.0, 6.28)) for f in random.uniform(0.2, 2.5, 4)]
            shape = 0.5 * np.sum(tones, axis=0) * held
        else:
            shape = np.zeros(count)
            quick = slow = 0.0
            for k in range(count):
                quick += dt * 4.0 * (random.normal() / np.sqrt(dt) - quick)
                slow += dt * 6.0 * (quick - slow)
                shape[k] = slow
            shape *= 0.7 / (shape.std() + 1e-12)
        size = one.size[j] * random.choice([-1.0, 1.0]) * random.uniform(0.4, 1.0)
        wanted[start : start + count, j] += size * shape
        start += length
        if random.uniform() < 0.15:
            start += round(random.uniform(5.0, 15.0) * one.rate)
    return wanted


def fly(one: Linear, random: np.random.Generator) -> tuple[Array, Array, Array, Array]:
    """Return what is recorded: time (n,), states, derivatives (n, .) and deflections (n, m)."""
    wanted = inputs(one, random)
    n, m = wanted.shape
    if one.damped:
        rest = round(REST * one.rate)
        wanted = np.concatenate([np.zeros((rest, m)), wanted[:-rest]])
    steps = max(1, round(1.0 / (one.rate * SUBSTEP)))
    dt = 1.0 / (one.rate * steps)
    x, u, gust = np.zeros(len(one.states)), np.zeros(m), 0.0
    late = [np.zeros(m)] * (round(one.delay / dt) + 1)
    mix = np.eye(m) if one.mix is None else one.mix
    axes = one.b @ mix
    b, push = one.b.copy(), one.gusts * GUST * one.speed * np.sqrt(2.0 * GUST_PACE * dt)
    seen, slopes, moved = np.zeros((n, len(x))), np.zeros((n, len(x))), np.zeros((n, m))
    of_states = np.array([NOISE["velocity"] * one.speed, *[NOISE["rate"]] * (len(x) - 1)])
    fed = one.noise * of_states * random.spawn(1)[0].normal(size=seen.shape) if one.damped else np.zeros(seen.shape)
    for k in range(n):
        if one.lost >= 0 and k >= one.time * one.rate:
            b[:, one.lost] = one.b[:, one.lost] * one.left
        command = wanted[k].copy()
        for j in range(m):
            command[j] -= one.feedback * (x[j + 1] + fed[k, j + 1]) / axes[j + 1, j] * abs(one.a[j + 1, j + 1])
        command = mix @ command
        air = x.copy()
        air[0] += gust
        seen[k], slopes[k] = x, b @ u + one.a @ air
        moved[k] = command if one.commands else u
        for _ in range(steps):
            late = [*late[1:], command]
            u = u + dt * one.servo * (late[0] - u) if one.servo > 0.0 else late[0]
            air = x.copy()
            air[0] += gust
            x = x + dt * (b @ u + one.a @ air)
            gust += -dt * GUST_PACE * gust + push * random.normal()
    of_slopes = np.array([NOISE["acceleration"], *[NOISE["angular acceleration"] * one.pace] * (len(x) - 1)])
    seen += fed if one.damped else one.noise * of_states * random.normal(size=seen.shape)
    slopes += one.noise * of_slopes * random.normal(size=slopes.shape)
    moved += one.noise * NOISE["deflection"] * random.normal(size=moved.shape)
    return np.arange(n) / one.rate, seen, slopes, moved


def keep(record: str, one: Linear, flight: tuple[Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
    """Return a flight as one of `RECORDS` holds it."""
    time, x, slopes, moved = flight
    if record == "coarse":
        moved = np.round(moved / COARSE) * COARSE
    elif record == "late":
        back = max(1, round(BEHIND * one.rate))
        moved = np.concatenate([np.repeat(moved[:1], back, axis=0), moved[:-back]])
    elif record == "held":
        moved = moved[np.arange(len(moved)) // HELD * HELD]
    elif record == "vane":
        x = x.copy()
        stays = np.exp(-1.0 / (one.rate * LAG))
        for k in range(1, len(x)):
            x[k, 0] = stays * x[k - 1, 0] + 0.5 * (1.0 - stays) * (flight[1][k - 1, 0] + flight[1][k, 0])
    elif record == "old velocity":
        x = x.copy()
        x[:, 0] = np.interp(time - BEHIND, time, x[:, 0])
    return time, x, slopes, moved


def configure(one: Linear) -> Configuration:
    """Return what the identifier is given: names and rate, nothing else."""
    names = {"states": one.states, "effectors": one.effectors, "known_gravity": False, "estimator.method": "bank"}
    return from_mapping({**names, "sample_rate": float(one.rate)})


def differentiate(
    one: Linear, flight: tuple[Array, Array, Array, Array], pace: int = 1
) -> tuple[Array, Array, Array, Array]:
    """Return a flight as mapped inputs give it where no derivative of a rate is measured: of every so manieth row."""
    time, x, slopes, moved = (array[::pace] for array in flight)
    n = x.shape[1]
    window = DerivativeFilter(usual_intervals(one.rate / pace), 2 * n + moved.shape[1], round(1e9))
    samples = zip(time, np.concatenate([x, slopes, moved], axis=1), strict=True)
    rows = [made for t, row in samples if (made := window.push(round(t * 1e9), row)) is not None]
    smooth, slope = (np.array([getattr(row, name) for row in rows]) for name in ("smooth", "slope"))
    derivatives = np.concatenate([smooth[:, n : n + 1], slope[:, 1:n]], axis=1)
    return np.array([row.stamp * 1e-9 for row in rows]), smooth[:, :n], derivatives, smooth[:, 2 * n :]


def judge(job: tuple[int, str, str]) -> Row:
    """Fly one of this seed, identify it on one of `PATHS` from one of `RECORDS`, and hold what is said against it."""
    seed, path, record = job
    random = np.random.default_rng(seed)
    one = draw(random)
    if record == "slow":
        one = replace(one, servo=SLOW, commands=True)
    if record == "damped":
        one = replace(one, damped=True, feedback=max(one.feedback, DAMPED))
    if record == "elevons":
        one = with_elevons(one, random)
    configuration, flight = configure(one), keep(record, one, fly(one, random))
    straddle = 0 if path == "direct" else usual_intervals(one.rate)
    samples = differentiate(one, flight, HELD if record == "held" else 1) if straddle else flight
    estimates = Identifier(configuration, straddle).run(*samples).estimates
    seen = 0.5 * straddle / one.rate  # a window's stamp is its middle
    events = [(e.time + seen, v) for e in estimates for v in e.events]
    alarms = [time for time, v in events if v.kind == EventKind.DETECTED]
    lost = one.time if one.lost >= 0 else np.inf
    found = [(time, v) for time, v in events if v.kind == EventKind.ISOLATED]
    right = [v for time, v in found if time >= lost and v.suspected_effector == one.effectors[one.lost]]
    own = [time for time in alarms if time >= lost]
    return {
        "seed": seed,
        "path": path,
        "lost": one.lost >= 0,
        "seen": any(time <= lost + LATE for time in own),
        "false": len(alarms) - len(own),
        "late": sum(time > lost + LATE for time in own),
        "right": len(right),
        "wrong": len(found) - len(right),
        "phases": count(one, estimates, [time - seen for time in alarms]),
    }


def count(one: Linear, estimates: Sequence[Estimate], alarms: Sequence[float]) -> Row:
    """Return by matrix and phase: numbers, how many are called reliable, how many of those are covered."""
    cells = {(matrix, phase): [0, 0, 0] for matrix in "AB" for phase in PHASES}
    for e in estimates[one.rate :: max(1, one.rate // 5)]:
        b = one.b.copy()
        if one.lost >= 0 and e.time >= one.time:
            b[:, one.lost] *= one.left
        last = max((time for time in alarms if time <= e.time), default=-np.inf)
        since = e.time - last
        unseen = one.lost >= 0 and last < one.time <= e.time
        phase = "1 s after" if since < 1.0 else "1-4 s after" if since < 4.0 else "loss not seen" if unseen else "late"
        for matrix, value, error, reliable, true in (
            ("A", e.a, e.a_std, e.a_reliable, one.a),
            ("B", e.b, e.b_std, e.b_reliable, b),
        ):
            cell = cells[matrix, phase]
            cell[0] += value.size
            cell[1] += int(reliable.sum())
            cell[2] += int((reliable & (np.abs(value - true) <= 1.96 * error)).sum())
    return {f"{matrix} {phase}": cell for (matrix, phase), cell in cells.items()}


def run(flights: int, first_seed: int, jobs: int, record: str = RECORDS[0]) -> Iterator[Row]:
    """Yield the rows of so many flights, both ways, from one of `RECORDS`."""
    seeds = range(first_seed, first_seed + flights)
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(judge, [(seed, path, record) for seed in seeds for path in PATHS])


def render(rows: Sequence[Row]) -> str:
    """Return them as a table."""
    return "\n".join(line for path in PATHS for line in render_path(path, [row for row in rows if row["path"] == path]))


def render_path(path: str, rows: Sequence[Row]) -> list[str]:
    """Return the lines of one of `PATHS`."""
    if not rows:
        return []
    lines = [f"{len(rows)} linear aircraft, {path}; share called reliable / coverage"]
    for matrix in "AB":
        cells = []
        for phase in PHASES:
            total, reliable, covered = (sum(row["phases"][f"{matrix} {phase}"][k] for row in rows) for k in range(3))
            cells.append(f"{phase} {reliable / total:.2f} {covered / reliable:.2f}" if reliable else f"{phase} none")
        lines.append(f"{matrix}   " + "   ".join(cells))
    sums = {key: sum(row[key] for row in rows) for key in ("lost", "seen", "false", "late", "right", "wrong")}
    lines.append(
        f"losses: {sums['lost']}, seen within {LATE:.0f} s {sums['seen']}, alarms later {sums['late']} (nothing shows "
        f"before the next input), false {sums['false']}; names right {sums['right']}, wrong {sums['wrong']}"
    )
    return lines
