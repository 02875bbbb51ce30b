"""Whether frames, signs, units and delays of a map agree with the motion, and which single change makes them agree.

The equations of `motion` are evaluated as the map reads the log; where one does not hold, the readings that a mistake
leads to are tried, and the one under which all hold is named.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from msls_ros.estimation.kernel import Array
from msls_ros.inputs.check_effectors import UNITS_OF_SPEED
from msls_ros.inputs.findings import DOUBTFUL, NOTE, WRONG, Finding, delay_words
from msls_ros.inputs.force_signs import check_force_signs
from msls_ros.inputs.frames import EARTH
from msls_ros.inputs.input_map import AIR_DATA, WIND
from msls_ros.inputs.mends import air_readings, force_readings, limit, mend
from msls_ros.inputs.misalignment import check_misalignment
from msls_ros.inputs.motion import Motion, Reading
from msls_ros.inputs.series import Record, Series, on_grid

_MOST = 6000
_STEP = 0.02
_LAG = 0.3
"""Delays looked for [s]."""
_LATE = 0.025
"""Delay worth naming [s]."""
_SEEN, _MENDED = 0.03, 0.25
"""A misfit of the forces that is looked at though it is within its limit, and the share that the mend of it leaves."""
_OFF_NOSE = 5.0
"""By which an aircraft flies off its nose in balanced flight [deg]."""
_AIRSPEED_OFF, _FLYING = 0.12, 3.0
"""Logarithm of the ratio of two airspeeds that is worth naming; airspeed from which they are compared [m/s]."""
_UNSURE = "the motion does not show which; not excluded are"
_ALONE = "the motion is too small to show it; alone not excluded is"
_WORDS = {
    "rates": "the attitude does not turn with the rates",
    "force": "the velocity does not change as the accelerometer says",
    "axis": "along an axis of the aircraft the velocity does not change as the accelerometer says",
    "weight": "over the flight the accelerometer does not carry the weight",
    "heading": "the aircraft does not fly ahead",
    "upright": "the aircraft flies upside down",
    "size": "the velocity changes by more, or less, than the accelerometer says",
}


def check_motion(record: Record, reference_speed: float) -> Iterator[Finding]:
    """Yield equations of motion that do not hold, with the change that mends them, and delays between the streams.

    Parameters
    ----------
    record
        What was read of the log.
    reference_speed
        Of the configuration [m/s]: no unit is named by which the aircraft would fly far from it.
    """
    found = motion_of(record)
    if found is None:
        return
    motion, reading, entries = found
    now = motion.misfits(reading)
    if not now:
        return
    bad = {name: value for name, value in now.items() if value > limit(name)}
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
        faint = [] if wind or signs else list(_faint(motion, reading, entries, reference_speed))
        which = "the other frames, signs and units" if faint else "frames, signs and units"
        yield Finding(NOTE, "motion", "inputs", f"{which} agree with the motion (misfits: {text})")
        yield from faint
        yield from _delays(record, motion, reading, entries, now)
        return
    mends, sure = mend(motion, reading, entries, reference_speed, bad)
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
    change = _alternatives(mends, sure)
    level = WRONG
    if not change:
        change = "no single frame, sign, unit or order mends it: check that these topics belong to one aircraft"
        turns = max((value for name, value in bad.items() if name.startswith("rates")), default=0.0)
        level = WRONG if turns > 1.0 or "weight" in bad else DOUBTFUL
    yield Finding(level, "motion", where, f"{what} (misfit {misfits}; 0 agrees, 2 unrelated, 4 opposite)", change)


def _alternatives(mends: list[tuple[str, str]], sure: bool) -> str:
    """Return changes as a sentence; empty where there are none."""
    words = ", or ".join(dict.fromkeys(f"{entry}: {change}" for entry, change in mends))
    if sure or not words:
        return words
    return f"{_UNSURE if len(mends) > 1 else _ALONE}: {words}"


def _faint(motion: Motion, reading: Reading, entries: Mapping[str, str], reference_speed: float) -> Iterator[Finding]:
    """Yield what a flight of small accelerations shows of the velocity: a change that mends it, or that it is not seen.

    Less is made of it than of large ones: gusts, levers and flexing may be as large.
    """
    entry = entries.get("velocity")
    if entry is None or "force" not in entries or motion.wind is not None or "force" in motion.misfits(reading):
        return
    faint = motion.misfits(reading, faint=True)
    off = {name: faint[name] for name in ("force", "size") if faint.get(name, 0.0) > limit(name)}
    mends, sure = mend(motion, reading, entries, reference_speed, off) if off else ([], True)
    if mends:
        misfits = ", ".join(f"{name} {value:.2g}" for name, value in off.items())
        what = f"{_WORDS[next(iter(off))]}, as far as so gentle a flight shows it (misfit {misfits})"
        yield Finding(DOUBTFUL, "motion", mends[0][0], what, _alternatives(mends, sure))
    elif off or "force" not in faint:
        what = "frame and unit of the velocity are not seen: the flight accelerates too little"
        yield Finding(NOTE, "motion", entry, what)


def _better(
    motion: Motion, reading: Reading, entries: Mapping[str, str], now: Mapping[str, float]
) -> Iterator[Finding]:
    """Yield a mistake in the small forces ahead and to the side, which the weight hides, where a change mends most."""
    tried = air_readings(reading) if "airspeed" in entries else force_readings(reading, entries["force"])
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
        **{f"scale={s:.6g}: it is in {unit}": reading.but(wind_scale=s) for unit, s in UNITS_OF_SPEED.items()},
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
    named = {unit: s for unit, s in UNITS_OF_SPEED.items() if abs(np.log(felt * s / made)) < 0.1}
    units = [f"scale={s:.6g}: it is in {unit}" for unit, s in named.items()]
    change = "map the wind: u, v, w are those over ground" if motion.wind is None else "check sign and unit of the wind"
    what = f"the airspeed is {felt:.3g} m/s in the median, {less} {made:.3g} m/s"
    yield Finding(DOUBTFUL, "airspeed", "inputs.airspeed", what, " or ".join([change, *units]))


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
        level = WRONG if after < 0.3 * before and before > limit(kind) else DOUBTFUL
        word = "later" if steps > 0 else "earlier"
        what = f"comes {1e3 * abs(steps) * motion.step:.0f} ms {word} than the attitude shows it"
        where = entries[group[0]] if len(group) == 1 else "inputs." + ", ".join(group)
        delays = {one.stream.delay * 1e-9 for name, one in record.series.items() if f"inputs.{name}" == where}
        change = delay_words(steps * motion.step, delays.pop() if delays else None, "this line")
        if group == ("airspeed",) and steps > 0:
            change += f"; or lag={steps * motion.step:.2g}, where a static port follows slowly"
        yield Finding(level, "delay", where, what, change)
