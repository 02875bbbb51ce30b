"""Whether frames, signs, units and delays of a map agree with the motion, and which single change makes them agree.

The equations of `motion` are evaluated as the map reads the log; where one does not hold, the readings that a mistake
leads to are tried, and the one under which all hold is named.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import permutations, product

import numpy as np

from msls_ros.estimation.kernel import Array
from msls_ros.inputs.findings import DOUBTFUL, NOTE, WRONG, Finding, delay_words
from msls_ros.inputs.force_signs import check_force_signs
from msls_ros.inputs.frames import BODY, EARTH
from msls_ros.inputs.input_map import AIR_DATA, WIND
from msls_ros.inputs.misalignment import check_misalignment
from msls_ros.inputs.motion import Motion, Reading
from msls_ros.inputs.series import Record, Series, on_grid

LIMITS = {"rates": 0.35, "force": 0.6, "axis": 1.2, "weight": 0.4, "heading": 0.4, "size": 0.35, "upright": 1.0}
"""Misfit above which an equation does not hold."""
_MOST = 6000
_STEP = 0.02
_LAG = 0.3
"""Delays looked for [s]."""
_LATE = 0.025
"""Delay worth naming [s]."""
_RAD = float(np.pi / 180.0)
_SEEN, _MENDED = 0.03, 0.25
"""A misfit of the forces that is looked at though it is within its limit, and the share that the mend of it leaves."""
_OFF_NOSE = 5.0
"""By which an aircraft flies off its nose in balanced flight [deg]."""
_AIRSPEED_OFF, _FLYING = 0.12, 3.0
"""Logarithm of the ratio of two airspeeds that is worth naming; airspeed from which they are compared [m/s]."""
_SPEEDS = {"knots": 0.514444, "km/h": 1.0 / 3.6, "ft/s": 0.3048, "cm/s": 0.01, "mm/s": 0.001}
_WORDS = {
    "rates": "the attitude does not turn with the rates",
    "force": "the velocity does not change as the accelerometer says",
    "axis": "along an axis of the aircraft the velocity does not change as the accelerometer says",
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
    if "rates" in entries and not any(name.startswith(("rates", "upright")) for name in bad):
        yield from check_misalignment(motion, reading, entries["rates"])
    wind = list(_wind(motion, reading, now))
    signs = [] if bad or wind or "force" not in entries else list(check_force_signs(motion, reading, entries["force"]))
    yield from signs
    if not bad and not wind and not signs and now.get("force", 0.0) > _SEEN:
        yield from _better(motion, reading, entries, now)
    yield from wind
    if not bad and not wind:
        yield from _airspeed(motion, reading)
    if not bad:
        text = ", ".join(f"{name} {value:.2g}" for name, value in now.items())
        yield Finding(NOTE, "motion", "inputs", f"frames, signs and units agree with the motion (misfits: {text})")
        yield from _delays(record, motion, reading, entries, now)
        return
    mends = mend(motion, reading, entries)
    late = [f for f in _delays(record, motion, reading, entries, now) if not (mends and f.where.endswith(AIR_DATA))]
    if late and all(name.startswith("rates") or name == "force" for name in bad):
        yield from late
        if any(f.level == WRONG for f in late):
            return
    kinds = dict.fromkeys(name.split()[0] for name in bad)
    if "force" in kinds:
        kinds.pop("axis", None)
    what = "; ".join(_WORDS[kind] for kind in kinds)
    misfits = ", ".join(f"{name} {value:.2g}" for name, value in bad.items())
    where = mends[0][0] if mends else "inputs"
    change = ", or ".join(dict.fromkeys(f"{entry}: {words}" for entry, words in mends))
    level = WRONG
    if not change:
        change = "no single frame, sign, unit or order mends it: check that these topics belong to one aircraft"
        turns = max((value for name, value in bad.items() if name.startswith("rates")), default=0.0)
        level = WRONG if turns > 1.0 or "weight" in bad else DOUBTFUL
    yield Finding(level, "motion", where, f"{what} (misfit {misfits}; 0 agrees, 2 unrelated, 4 opposite)", change)


def _better(
    motion: Motion, reading: Reading, entries: Mapping[str, str], now: Mapping[str, float]
) -> Iterator[Finding]:
    """Yield a mistake in the small forces ahead and to the side, which the weight hides, where a change mends most."""
    tried = _air(reading) if "airspeed" in entries else _forces(reading, entries["force"])
    best, changed = now["force"], ("", "")
    for other, entry, words in tried:
        misfits = motion.misfits(other)
        one = misfits.get("force", best)
        if one < best and all(misfits.get(name, 0.0) < value + 0.02 for name, value in now.items()):
            best, changed = one, (entry, words)
    if best < _MENDED * now["force"]:
        what = f"{_WORDS['axis']}: one change brings the misfit of the forces from {now['force']:.2g} to {best:.2g}"
        yield Finding(WRONG, "motion", changed[0], what, ": ".join(changed))


def _wind(motion: Motion, reading: Reading, now: Mapping[str, float]) -> Iterator[Finding]:
    """Yield that less the wind the aircraft flies off its nose, where another reading of the wind keeps it on it."""
    if motion.wind is None or "heading" not in now:
        return
    readings = {
        "scale=-1: it is where the wind comes from": reading.but(wind_scale=-1.0),
        "north and east are exchanged": reading.but(wind_axes=(1, 0, 2)),
        **{f"scale={s:.6g}: it is in {unit}": reading.but(wind_scale=s) for unit, s in _SPEEDS.items()},
    }
    tried = {words: motion.misfits(other)["heading"] for words, other in readings.items()}
    change = min(tried, key=lambda words: tried[words])
    without = motion.misfits(reading.but(wind_scale=0.0))["heading"]
    off, on = (float(np.degrees(np.arccos(max(-1.0, 1.0 - h)))) for h in (now["heading"], min(tried[change], without)))
    if off * off < 2.0 * on * on + _OFF_NOSE**2:
        return
    what = f"less this wind the aircraft flies {off:.0f} deg off its nose, "
    if tried[change] < 0.5 * without:
        yield Finding(WRONG, "wind", "inputs.wind", f"{what}otherwise {on:.0f}", change)
    else:
        mend = "leave it out, or check its sign, unit and frame"
        yield Finding(WRONG, "wind", "inputs.wind", f"{what}without it {on:.0f}", mend)


def _airspeed(motion: Motion, reading: Reading) -> Iterator[Finding]:
    """Yield that the airspeed is not the size of the velocity, less the wind."""
    speed = motion.air_speed(reading)
    if speed is None or motion.airspeed is None or motion.alpha is not None:
        return
    flying = motion.airspeed[:, 0] > _FLYING
    if flying.mean() < 0.2:
        return
    felt, made = float(np.median(motion.airspeed[flying, 0])), float(np.median(speed[flying]))
    if abs(np.log(felt / made)) < _AIRSPEED_OFF:
        return
    less = "the velocity" if motion.wind is None else "the velocity less the wind"
    units = [f"scale={s:.6g}: it is in {unit}" for unit, s in _SPEEDS.items() if abs(np.log(felt * s / made)) < 0.1]
    change = "map the wind: u, v, w are those over ground" if motion.wind is None else "check sign and unit of the wind"
    what = f"the airspeed is {felt:.3g} m/s in the median, {less} {made:.3g} m/s"
    yield Finding(DOUBTFUL, "airspeed", "inputs.airspeed", what, " or ".join([change, *units]))


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
        **{name: (name,) for name in AIR_DATA if "velocity" not in record.series},
    }  # fmt: skip
    parts = {"rates": ("states.P", "states.Q", "states.R"), "velocity": ("states.u", "states.v", "states.w")}
    chosen: dict[str, list[Series]] = {}
    entries: dict[str, str] = {}
    for signal, names in groups.items():
        for option in (names, parts.get(signal, ())):
            if option and signal not in chosen and all(n in record.series for n in option):
                chosen[signal] = [record.series[n] for n in option]
                entries[signal] = "inputs." + (option[0] if len(option) == 1 else "states")
    if len(chosen.keys() & set(AIR_DATA)) < len(AIR_DATA):
        chosen = {signal: several for signal, several in chosen.items() if signal not in AIR_DATA}
        entries = {signal: entry for signal, entry in entries.items() if signal not in AIR_DATA}
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
    begin = max(int(one.stamps[0]) for one in flat.values())
    wind = wind_of(record, begin * 1e-9 + grid[0]) if "velocity" in record.series else None
    if "velocity" in chosen and "airspeed" in record.series:
        air = record.series["airspeed"]
        joined["airspeed"] = np.interp(begin * 1e-9 + grid[0], air.time, air.values[:, 0])[:, None]
    apart = 2 * max(1, round(period / step))
    motion = Motion(step, **joined, vane=record.inputs.vane_position, wind=wind, apart=apart)
    return motion, reading, entries


def wind_of(record: Record, time: Array) -> Array | None:
    """Return the wind (k, 3) in NED at instants [s]; None: it is not mapped."""
    series = record.series.get(WIND)
    if series is None:
        return None
    parts = [np.interp(time, series.time, column) for column in series.values.T]
    parts += [np.zeros(len(time))] * (3 - len(parts))
    return np.stack([sign * parts[place] for place, sign in EARTH[series.stream.earth]], axis=1)


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
        yield from _angles(reading)
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
        yield reading.but(force_scale=(9.80665,) * 3), entry, "scale=9.80665: it is in g"
        for factor in (2.0, 0.5, 0.01, 0.001):
            yield reading.but(force_scale=(factor,) * 3), entry, f"{factor:g} times the scale"
        yield from _forces(reading, entry)
        yield reading.but(weightless=True), entry, "leave it out, or map the raw one: gravity has been taken off it"
    if "airspeed" in entries:
        yield from _air(reading)
    for body, earth in product(BODY, EARTH):
        flown = reading.velocity_frame
        changed = reading.but(
            attitude_body=body, attitude_earth=earth, rates_frame=body, force_frame=body,
            velocity_frame=body if flown in BODY else earth,
        )  # fmt: skip
        yield changed, "inputs", f"frame={body} for body vectors, frame={body}/{earth} for the attitude"


def _angles(reading: Reading) -> Iterator[tuple[Reading, str, str]]:
    entry = "inputs.states.Phi, Theta, Psi"
    yield reading.but(attitude_scale=(_RAD,) * 3), entry, f"scale={_RAD:.8f}: they are degrees"
    for i, name in enumerate(("Phi", "Theta", "Psi")):
        for factor, words in ((-1.0, "its sign is wrong"), (_RAD, f"scale={_RAD:.8f}: it is in degrees")):
            scale = tuple(factor if j == i else 1.0 for j in range(3))
            yield reading.but(attitude_scale=scale), f"inputs.states.{name}", words
    for axes in permutations(range(3)):
        if axes != (0, 1, 2):
            names = ", ".join(("Phi", "Theta", "Psi")[a] for a in axes)
            yield reading.but(attitude_axes=axes), entry, f"the angles are exchanged: they hold {names}"


def _air(reading: Reading) -> Iterator[tuple[Reading, str, str]]:
    """Yield mistakes in airspeed and the angles of the vanes."""
    for unit, scale in _SPEEDS.items():
        yield reading.but(air_scale=(scale, 1.0, 1.0)), "inputs.airspeed", f"scale={scale:.6g}: it is in {unit}"
    degrees = f"scale={_RAD:.8f}: degrees"
    for a, b in product((1.0, -1.0, _RAD, -_RAD), repeat=2):
        named = [
            f"{name}: {degrees if abs(s) == _RAD else ''}{', and ' if s == -_RAD else ''}"
            f"{'the sign is wrong: scale=-1' if s < 0.0 else ''}"
            for name, s in (("alpha", a), ("beta", b))
            if s != 1.0
        ]
        if named:
            yield reading.but(air_scale=(1.0, a, b)), "inputs", "; ".join(named)
    yield reading.but(air_axes=(0, 2, 1)), "inputs.alpha, beta", "the two are exchanged"
    for factor, words in ((-1.0, "the sign: forward, right, down are positive"), (0.001, "in metres")):
        yield reading.but(vane_scale=factor), "inputs.vane_position", words


def _forces(reading: Reading, entry: str) -> Iterator[tuple[Reading, str, str]]:
    """Yield exchanged axes and wrong signs of the accelerometer."""
    yield reading.but(force_scale=(-1.0,) * 3), entry, "scale=-1"
    for signs in product((1.0, -1.0), repeat=3):
        if -1 < sum(signs) < 3.0:
            yield reading.but(force_scale=signs), entry, "scale=" + ",".join(f"{s:g}" for s in signs)
    for axes in permutations(range(3)):
        if axes != (0, 1, 2):
            yield reading.but(force_axes=axes), entry, _exchanged(axes)


def _exchanged(axes: tuple[int, ...]) -> str:
    order = ",".join("xyz"[a] for a in axes)
    return f"three paths in the order {order}: the axes are exchanged"


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
            yield reading.but(rates_axes=axes), entry, _exchanged(axes)


def _delays(
    record: Record, motion: Motion, reading: Reading, entries: Mapping[str, str], now: Mapping[str, float]
) -> Iterator[Finding]:
    """Yield the streams that are late against the attitude; of those in one equation the one that mends it best."""
    most = int(_LAG / motion.step)
    motion = replace(motion, apart=0)  # less noise, what is left of a sound log is small, and any part of it
    tried: dict[str, list[tuple[str, ...]]] = {
        "rates": [("rates",)], "force": [("force",), AIR_DATA, *((name,) for name in AIR_DATA)],
    }  # fmt: skip
    for kind, groups in tried.items():
        names = [name for name in now if name.split()[0] in ((kind, "axis") if kind == "force" else (kind,))]
        found: list[tuple[float, int, tuple[str, ...]]] = []
        for group in groups if names else ():
            if not set(group) <= entries.keys():
                continue
            scores = []
            for steps in range(-most, most + 1):
                misfits = motion.shifted(group, steps).misfits(reading)
                scores.append(sum(misfits.get(name, 0.0) for name in names))
            best, before = int(np.argmin(scores)), scores[most]
            lag = (best - most) * motion.step
            if best not in (0, 2 * most) and abs(lag) >= max(_LATE, 1.5 * motion.step) and scores[best] <= 0.6 * before:
                found.append((scores[best], best - most, group))
        if not found:
            continue
        after, steps, group = min(found)
        level = WRONG if after < 0.3 * before and before > _limit(kind) else DOUBTFUL
        word = "later" if steps > 0 else "earlier"
        what = f"comes {1e3 * abs(steps) * motion.step:.0f} ms {word} than the attitude shows it"
        where = entries[group[0]] if len(group) == 1 else "inputs." + ", ".join(group)
        delays = {one.stream.delay * 1e-9 for name, one in record.series.items() if f"inputs.{name}" == where}
        change = delay_words(steps * motion.step, delays.pop() if delays else None, "this line")
        if group == ("airspeed",) and steps > 0:
            change += f"; or lag={steps * motion.step:.2g}, where a static port follows slowly"
        yield Finding(level, "delay", where, what, change)
