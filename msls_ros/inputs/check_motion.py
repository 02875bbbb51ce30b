"""Whether frames, signs, units and delays of a map agree with the motion, and which single change makes them agree.

The equations of `motion` are evaluated as the map reads the log; where one does not hold, the readings that a mistake
leads to are tried, and the one under which all hold is named.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import permutations, product

import numpy as np

from msls_ros.inputs.findings import DOUBTFUL, NOTE, WRONG, Finding
from msls_ros.inputs.frames import BODY, EARTH
from msls_ros.inputs.motion import Motion, Reading
from msls_ros.inputs.series import Record, Series, on_grid

LIMITS = {"rates": 0.35, "force": 0.6, "weight": 0.4, "heading": 0.4, "size": 0.35, "upright": 1.0}
"""Misfit above which an equation does not hold."""
_MOST = 6000
_STEP = 0.02
_LAG = 0.3
"""Delays looked for [s]."""
_LATE = 0.025
"""Delay worth naming [s]."""
_RAD = float(np.pi / 180.0)
_SPEEDS = {"knots": 0.514444, "km/h": 1.0 / 3.6, "ft/s": 0.3048, "cm/s": 0.01, "mm/s": 0.001}
_WORDS = {
    "rates": "the attitude does not turn with the rates",
    "force": "the velocity does not change as the accelerometer says",
    "weight": "over the flight the accelerometer does not carry the weight",
    "heading": "the aircraft does not fly ahead",
    "upright": "the aircraft flies upside down",
    "size": "the velocity changes by more, or less, than the accelerometer says",
}


def check_motion(record: Record) -> Iterator[Finding]:
    """Yield equations of motion that do not hold, with the change that mends them, and delays between the streams."""
    found = motion_of(record)
    if found is None:
        return
    motion, reading, entries = found
    now = motion.misfits(reading)
    if not now:
        return
    bad = {name: value for name, value in now.items() if value > _limit(name)}
    if not bad:
        text = ", ".join(f"{name} {value:.2g}" for name, value in now.items())
        yield Finding(NOTE, "motion", "inputs", f"frames, signs and units agree with the motion (misfits: {text})")
        yield from _delays(motion, reading, entries, now)
        return
    late = list(_delays(motion, reading, entries, now))
    if late and all(name.startswith("rates") or name == "force" for name in bad):
        yield from late
        if any(f.level == WRONG for f in late):
            return
    kinds = dict.fromkeys(name.split()[0] for name in bad)
    what = "; ".join(_WORDS[kind] for kind in kinds)
    misfits = ", ".join(f"{name} {value:.2g}" for name, value in bad.items())
    mends = mend(motion, reading, entries)
    where = mends[0][0] if mends else "inputs"
    change = ", or ".join(dict.fromkeys(f"{entry}: {words}" for entry, words in mends))
    level = WRONG
    if not change:
        change = "no single frame, sign, unit or order mends it: check that these topics belong to one aircraft"
        turns = max((value for name, value in bad.items() if name.startswith("rates")), default=0.0)
        level = WRONG if turns > 1.0 or "weight" in bad else DOUBTFUL
    yield Finding(level, "motion", where, f"{what} (misfit {misfits}; 0 agrees, 2 unrelated, 4 opposite)", change)


def _limit(name: str) -> float:
    return LIMITS[name.split()[0]]


def motion_of(record: Record) -> tuple[Motion, Reading, Mapping[str, str]] | None:
    """Return the motion of a record, how its map reads it, and the entry of the map behind each signal.

    Returns
    -------
    tuple or None
        None where attitude is not mapped, or the streams share no second.
    """
    groups = {
        "quaternion": ("attitude",), "euler": ("states.Phi", "states.Theta", "states.Psi"),
        "rates": ("angular_velocity",), "velocity": ("velocity",), "force": ("specific_force",),
    }  # fmt: skip
    parts = {"rates": ("states.P", "states.Q", "states.R"), "velocity": ("states.u", "states.v", "states.w")}
    chosen: dict[str, list[Series]] = {}
    entries: dict[str, str] = {}
    for signal, names in groups.items():
        for option in (names, parts.get(signal, ())):
            if option and signal not in chosen and all(n in record.series for n in option):
                chosen[signal] = [record.series[n] for n in option]
                entries[signal] = "inputs." + (option[0] if len(option) == 1 else "states")
    if not {"quaternion", "euler"} & chosen.keys() or len(chosen) < 2:
        return None
    flat = {f"{signal}{i}": one for signal, several in chosen.items() for i, one in enumerate(several)}
    if any(len(one.stamps) < 10 for one in flat.values()):
        return None
    period = max(float(np.median(np.diff(one.stamps))) * 1e-9 for one in flat.values())
    step = max(_STEP, 0.5 * period)
    grid = on_grid(flat, step, _MOST)
    if grid is None:
        return None
    joined = {
        signal: np.concatenate([grid[1][f"{signal}{i}"] for i in range(len(several))], axis=1)
        for signal, several in chosen.items()
    }
    reading = Reading()
    for signal, several in chosen.items():
        stream = several[0].stream
        if signal == "quaternion":
            reading = reading.but(attitude_body=stream.body, attitude_earth=stream.earth)
        elif signal in ("rates", "force"):
            reading = reading.but(**{f"{signal}_frame": stream.body or "frd"})
        elif signal == "velocity":
            reading = reading.but(velocity_frame=stream.earth or stream.body or "frd")
    return Motion(step, **joined), reading, entries


def mend(motion: Motion, reading: Reading, entries: Mapping[str, str]) -> list[tuple[str, str]]:
    """Return the single changes of a reading under which all equations hold, the best first; two at most.

    Returns
    -------
    list of tuple
        Entry of the map, and what to write there.
    """
    best: list[tuple[bool, float, str, str]] = []
    for changed, entry, words in _readings(reading, entries):
        misfits = motion.misfits(changed)
        excess = max((value / _limit(name) for name, value in misfits.items()), default=9.0)
        if excess < 1.0:
            best.append((entry == "inputs", sum(misfits.values()), entry, words))
    best.sort()
    like = [b for b in best[:2] if b[0] == best[0][0] and b[1] < 1.3 * best[0][1] + 0.02]
    return [(entry, words) for _, _, entry, words in like]


def _readings(reading: Reading, entries: Mapping[str, str]) -> Iterator[tuple[Reading, str, str]]:
    """Yield readings that differ from one in what one mistake makes of it, the entry and what to write."""
    if "quaternion" in entries:
        yield from _attitudes(reading, entries["quaternion"])
    if "euler" in entries:
        yield reading.but(attitude_scale=_RAD), "inputs.states.Phi, Theta, Psi", f"scale={_RAD:.8f}: they are degrees"
    if "rates" in entries:
        yield from _rates(reading, entries["rates"])
    if "velocity" in entries:
        entry = entries["velocity"]
        for frame in (*BODY, *EARTH):
            if frame != reading.velocity_frame:
                yield reading.but(velocity_frame=frame), entry, f"frame={frame}"
        for unit, scale in _SPEEDS.items():
            yield reading.but(velocity_scale=scale), entry, f"scale={scale:.6g}: it is in {unit}"
        yield reading.but(velocity_scale=-1.0), entry, "scale=-1"
    if "force" in entries:
        entry = entries["force"]
        for frame in BODY:
            if frame != reading.force_frame:
                yield reading.but(force_frame=frame), entry, f"frame={frame}"
        yield reading.but(force_scale=-1.0), entry, "scale=-1"
        yield reading.but(force_scale=9.80665), entry, "scale=9.80665: it is in g"
        yield reading.but(weightless=True), entry, "leave it out, or map the raw one: gravity has been taken off it"
    for body, earth in product(BODY, EARTH):
        flown = reading.velocity_frame
        changed = reading.but(
            attitude_body=body, attitude_earth=earth, rates_frame=body, force_frame=body,
            velocity_frame=body if flown in BODY else earth,
        )  # fmt: skip
        yield changed, "inputs", f"frame={body} for body vectors, frame={body}/{earth} for the attitude"


def _attitudes(reading: Reading, entry: str) -> Iterator[tuple[Reading, str, str]]:
    for body, earth in product(BODY, EARTH):
        if (body, earth) != (reading.attitude_body, reading.attitude_earth):
            yield reading.but(attitude_body=body, attitude_earth=earth), entry, f"frame={body}/{earth}"
    last = reading.but(order=(3, 0, 1, 2))
    yield last, entry, "give w first, as four paths w,x,y,z: the numbers hold w last"
    yield reading.but(conjugate=True), entry, "the rotation is the other way round, from earth to body"


def _rates(reading: Reading, entry: str) -> Iterator[tuple[Reading, str, str]]:
    for frame in BODY:
        if frame != reading.rates_frame:
            yield reading.but(rates_frame=frame), entry, f"frame={frame}"
    yield reading.but(rates_scale=(_RAD,) * 3), entry, f"scale={_RAD:.8f}: they are in deg/s"
    yield reading.but(rates_scale=(1.0 / _RAD,) * 3), entry, "no scale: they are in rad/s already"
    for signs in product((1.0, -1.0), repeat=3):
        if min(signs) < 0.0:
            turned = ", ".join(n for n, s in zip("PQR", signs, strict=True) if s < 0.0)
            several = "scale=" + ",".join(f"{s:g}" for s in signs)
            yield reading.but(rates_scale=signs), entry, f"{several}: the sign of {turned} is wrong"
    for axes in permutations(range(3)):
        if axes != (0, 1, 2):
            order = ",".join("xyz"[a] for a in axes)
            yield reading.but(rates_axes=axes), entry, f"three paths in the order {order}: the axes are exchanged"


def _delays(
    motion: Motion, reading: Reading, entries: Mapping[str, str], now: Mapping[str, float]
) -> Iterator[Finding]:
    """Yield the streams that are late against the attitude."""
    most = int(_LAG / motion.step)
    for signal, kind in (("rates", "rates"), ("force", "force"), ("velocity", "heading")):
        if kind == "heading" or signal not in entries or not any(name.startswith(kind) for name in now):
            continue
        scores = []
        for steps in range(-most, most + 1):
            misfits = motion.shifted(signal, steps).misfits(reading)
            scores.append(sum(value for name, value in misfits.items() if name.startswith(kind)))
        best = int(np.argmin(scores))
        lag, before = (best - most) * motion.step, scores[most]
        if best in (0, 2 * most) or abs(lag) < max(_LATE, 1.5 * motion.step) or scores[best] > 0.6 * before:
            continue
        level = WRONG if scores[best] < 0.3 * before and before > _limit(kind) else DOUBTFUL
        word = "later" if lag > 0.0 else "earlier"
        what = f"comes {1e3 * abs(lag):.0f} ms {word} than the attitude shows it"
        yield Finding(level, "delay", entries[signal], what, f"delay larger by {lag:+.3f} s in this line")
