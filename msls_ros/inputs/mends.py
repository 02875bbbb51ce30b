"""Single changes of a map under which the equations of `motion` hold: what one mistake makes of its numbers, undone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import permutations, product

import numpy as np

from msls_ros.inputs.check_effectors import SPEEDS, UNITS_OF_SPEED, speed_of_flight
from msls_ros.inputs.frames import BODY, EARTH
from msls_ros.inputs.motion import Motion, Reading

LIMITS = {"rates": 0.35, "force": 0.6, "axis": 1.2, "weight": 0.4, "heading": 0.4, "size": 0.35, "upright": 1.0}
"""Misfit above which an equation does not hold."""
_RAD = float(np.pi / 180.0)
_ALIKE = 0.15
"""Logarithm of a ratio of sizes that says nothing against a unit: .085 of a right map, in a flight without noise whose
accelerometer is .5 m ahead; km/h and ft/s are .09 apart."""
_FEW = 4
"""Changes that are named, where a flight does not show which of several it is."""


def limit(name: str) -> float:
    """Return the misfit above which an equation of this name does not hold."""
    return LIMITS[name.split()[0]]


def mend(
    motion: Motion,
    reading: Reading,
    entries: Mapping[str, str],
    reference_speed: float,
    bad: Iterable[str],
) -> tuple[list[tuple[str, str]], bool]:
    """Return the single changes of a reading under which all equations hold, the best first.

    An equation that a change only makes too small to be seen does not hold by it. A velocity of nearly none has no
    rotation to be compared, and what the accelerometer feels is left unexplained: that is a misfit of 2, however small
    both sides are. Where noise hides even that, changes remain that the flight does not exclude.

    Parameters
    ----------
    motion, reading, entries
        As `motion_of` returns them.
    reference_speed
        See `check_motion`.
    bad
        Names of the equations that do not hold.

    Returns
    -------
    list of tuple
        Entry of the map, and what to write there: two at most, or `_FEW` of what is not excluded.
    bool
        Whether all equations that do not hold now are seen to hold by them.
    """
    broken = {*bad} & {"force", "size", "heading"} or {name for name in bad if name.startswith("axis")}
    best: list[tuple[bool, bool, bool, float, str, str]] = []
    for changed, entry, words in _readings(reading, entries):
        likely = _likely(motion, reading, changed, reference_speed)
        if likely is None:
            continue
        misfits = motion.misfits(changed)
        judged = broken | ({"force", "size", "heading"} if _moved(reading) != _moved(changed) else set())
        if judged - misfits.keys():
            faint = motion.misfits(changed, faint=True)
            misfits.update((name, faint[name]) for name in judged & faint.keys())
        excess = max((value / limit(name) for name, value in misfits.items()), default=9.0)
        if misfits.get("size", 1.0) < _ALIKE:
            misfits["size"] = 0.0
        if excess < 1.0:
            unseen = not broken <= misfits.keys()
            best.append((unseen, not likely, entry == "inputs", sum(misfits.values()), entry, words))
    best.sort()
    if best and best[0][0]:
        return [b[-2:] for b in best[:_FEW] if b[1] == best[0][1]], False
    return [b[-2:] for b in best[:2] if b[:3] == best[0][:3] and b[3] < 1.3 * best[0][3] + 0.02], True


def _moved(reading: Reading) -> tuple[object, ...]:
    """Return what the velocity in the frame of the earth depends on."""
    r = reading
    attitude = r.attitude_body, r.attitude_earth, r.order, r.conjugate, r.attitude_scale, r.attitude_axes
    return *attitude, r.velocity_frame, r.velocity_scale, r.air_scale, r.air_axes


def _likely(motion: Motion, reading: Reading, changed: Reading, reference: float) -> bool | None:
    """Return whether by a change of the unit of speed the aircraft flies as fast as it is said to.

    Returns
    -------
    bool or None
        None where it would fly further from that speed than it does now; True where the unit stays.
    """
    raw = motion.velocity if motion.velocity is not None else motion.airspeed
    scales = [abs(one.velocity_scale * one.air_scale[0]) for one in (reading, changed)]
    if raw is None or scales[0] == scales[1]:
        return True
    before, after = (speed_of_flight(raw) * scale / reference for scale in scales)
    if min(before, after) <= 0.0:
        return None
    if SPEEDS[0] < after < SPEEDS[1]:
        return True
    return False if abs(np.log(after)) < abs(np.log(before)) else None


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
        for unit, scale in UNITS_OF_SPEED.items():
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
        yield from force_readings(reading, entry)
        yield reading.but(weightless=True), entry, "leave it out, or map the raw one: gravity has been taken off it"
    if "airspeed" in entries:
        yield from air_readings(reading)
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


def air_readings(reading: Reading) -> Iterator[tuple[Reading, str, str]]:
    """Yield mistakes in airspeed and the angles of the vanes."""
    for unit, scale in UNITS_OF_SPEED.items():
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


def force_readings(reading: Reading, entry: str) -> Iterator[tuple[Reading, str, str]]:
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
