"""Do the effectors move, apart from each other, within their range, in radians? Yields findings; see `findings`."""

from __future__ import annotations

from collections.abc import Container, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation.kernel import Array
from msls_ros.inputs.findings import DOUBTFUL, NOTE, WRONG, Finding
from msls_ros.inputs.series import Record, Series, on_grid

_STILL = np.radians(0.02)
"""Rms below which a surface does not move [rad]."""
_QUIET = np.radians(0.3)
"""Rms below which it hardly does [rad]."""
_LARGE = 0.8
"""Deflections beyond this are no surface's, or no radians [rad]."""
_COLLINEAR = 0.9995
"""R2 of an effector on the others from which they are one."""
_TOGETHER = 0.98
"""R2 of an effector on the others from which it is noted by how little it moves alone."""
_CLIPPED = 0.02
"""Share of samples at the end of the range from which it is called saturated."""
_REST, _STEPS = 3, 0.8
"""Samples of a rest, and share of the arrivals at an end that come from one, by which an input is one of steps."""
_OFTEN = 3
"""Visits to an end from which it may be a limit: a stabilizer that is trimmed comes to rest there once or twice."""
SPEEDS = (0.4, 2.5)
"""Speeds over `reference_speed` between which they are of one aircraft, from its stall to its dive."""
UNITS_OF_SPEED = {"knots": 0.514444, "km/h": 1.0 / 3.6, "ft/s": 0.3048, "cm/s": 0.01, "mm/s": 0.001}
"""In m/s."""
_NEAR = 0.3
"""Logarithm of the ratio to `reference_speed` of a speed in a unit that is named: aircraft are flown so far off it."""
_FLIES = (1.0, 2500.0)
"""Speeds between which aircraft fly [m/s]: of air loads at less hardly anything is left, the X-15 reached 2020."""
_EFFECTORS = "effectors."


def effectors_of(record: Record) -> dict[str, Series]:
    """Return the effectors of a record by their names."""
    return {n.removeprefix(_EFFECTORS): s for n, s in record.series.items() if n.startswith(_EFFECTORS)}


def check_effectors(record: Record, thrust: Container[str] = ()) -> Iterator[Finding]:
    """Yield surfaces that are still, saturated, collinear or of a strange size.

    Parameters
    ----------
    record
        What was read of the log.
    thrust
        Effectors that thrust makes: their deflections need be no angles, so that nothing is said of their size.
    """
    found = effectors_of(record)
    moving = {}
    for name, series in found.items():
        values = series.values[:, 0]
        where = f"inputs.{_EFFECTORS}{name}"
        angle = name not in thrust
        size = next(_size(where, series), None) if angle else None
        if size is not None:
            yield size
        rms = float(values.std())
        if np.ptp(values) == 0.0 or (angle and rms < _STILL):
            what = (
                f"constant at {values[0]:.4g}" if np.ptp(values) == 0.0 else f"moves by {np.degrees(rms):.2g} deg rms"
            )
            mend = "map the channel that drives it, or leave it out of effectors"
            yield Finding(WRONG, "constant", where, f"{what}: its column of B cannot be known", mend)
            continue
        moving[name] = series
        if angle and rms < _QUIET and size is None:
            what = f"moves by {np.degrees(rms):.2g} deg rms only: its column of B will hardly be known"
            mend = "fly doublets of a degree or more on it; if it did move more, its scale is too small"
            yield Finding(DOUBTFUL, "excitation", where, what, mend)
        yield from _saturation(where, values, angle=angle)
    yield from _collinear(moving)


def _size(where: str, series: Series) -> Iterator[Finding]:
    """Yield that a deflection is no angle in radians."""
    values = series.values[:, 0]
    stream = series.stream
    largest, middle = float(np.abs(values).max()), float(np.median(values))
    if 700.0 < middle < 2300.0:
        what = f"values about {middle:.0f} are pulses in microseconds, not radians"
        yield Finding(WRONG, "units", where, what, "zero=1500 scale=0.00109 (25 deg at 400 us), with your own numbers")
    elif largest > 2.0:
        what = f"reaches {largest:.3g} rad, {np.degrees(largest):.0f} deg: no surface does; degrees, or a percentage?"
        yield Finding(WRONG, "units", where, what, f"scale={np.pi / 180.0 * stream.scale[0]:.6g}, where it is degrees")
    elif largest > _LARGE:
        what = f"reaches {largest:.3g} rad, {np.degrees(largest):.0f} deg: rather a command from -1 to 1 than an angle"
        yield Finding(WRONG, "units", where, what, "scale=0.436 (25 deg at full command), with your own angle")


def _saturation(where: str, values: Array, *, angle: bool) -> Iterator[Finding]:
    near = 1e-6 * float(np.ptp(values))
    for end, word in ((values.max(), "upper"), (values.min(), "lower")):
        at_end = np.abs(values - end) <= near
        share = float(at_end.mean())
        stays = share > _CLIPPED and share * len(values) > 5
        if stays and abs(end - np.median(values)) > 0.6 * np.ptp(values) / 2.0 and not _in_steps(values, at_end, near):
            size = f"{np.degrees(end):.1f} deg" if angle else f"{end:.3g}"
            what = f"{100.0 * share:.0f} % of the time at its {word} end, {size}: saturated"
            yield Finding(DOUBTFUL, "saturation", where, what, "record the surface, not the command, if it can be had")


def _in_steps(values: Array, at_end: NDArray[np.bool_], near: float) -> bool:
    """Whether values (k,) rest at an end (k,) as a multistep input does, which is not limited there.

    It goes from rest to rest, at once; or, through a servo, it rests most of the time, and between the ends as often
    and as long as at this one; or it comes there once or twice only, as a trim does. What a law commands beyond a limit
    comes to the end on its way, again and again.
    """
    begin = np.append(0, np.flatnonzero(np.abs(np.diff(values)) > near) + 1)
    length = np.diff(np.append(begin, len(values)))
    rests = length >= _REST
    touches = np.logical_or.reduceat(at_end, begin)
    if int(touches.sum()) < _OFTEN:
        return True
    ends = touches & rests
    extreme = np.minimum(values.max() - values[begin], values[begin] - values.min()) <= 0.01 * np.ptp(values)
    visits = np.flatnonzero(ends)
    arrivals = visits[visits > 0]
    if not len(arrivals):
        return False
    at_once = rests[arrivals - 1] | ((length[arrivals - 1] == 1) & rests[np.maximum(arrivals - 2, 0)])
    if float(at_once.mean()) > _STEPS:
        return True
    long = rests & (length >= 0.5 * float(np.median(length[visits])))
    between = long & ~extreme & ~ends
    as_often = 2 * int(between.sum()) >= len(visits) and length[between].sum() >= length[ends].sum()
    return bool(as_often and length[long].sum() > 0.5 * len(values))


def _collinear(moving: dict[str, Series]) -> Iterator[Finding]:
    """Yield effectors that others make up: pairs in a fixed ratio, as of one channel; then sums, as of a law."""
    if len(moving) < 2:
        return
    step = min(float(np.median(np.diff(s.stamps))) * 1e-9 for s in moving.values() if len(s.stamps) > 1)
    grid = on_grid(moving, max(step, 0.01), 20000)
    if grid is None:
        return
    names = list(moving)
    values = np.concatenate([grid[1][name] for name in names], axis=1)
    count = len(values)
    triangle: Any = np.linalg.qr(values - values.mean(axis=0), mode="r")
    values = triangle  # few rows, of which all products are the same
    gone: set[str] = set()
    for i, first in enumerate(names):
        for j in range(i + 1, len(names)):
            a, b = values[:, i], values[:, j]
            power = float(a @ a) * float(b @ b)
            if power > 0.0 and (a @ b) ** 2 / power > _COLLINEAR:
                ratio = float(a @ b) / float(a @ a)
                gone.add(names[j])
                what = f"{names[j]} moves {ratio:+.3g} times as {first} does, always: their effects cannot be separated"
                mend = f"map one of the two, or move them apart; {first} then stands for both"
                yield Finding(WRONG, "collinear", f"inputs.{_EFFECTORS}{names[j]}", what, mend)
    free = [k for k, name in enumerate(names) if name not in gone]
    nearest: tuple[float, str, str] | None = None
    for k in free:
        rest = [j for j in free if j != k]
        power = float(values[:, k] @ values[:, k])
        if not rest or not power:
            continue
        weights, *_ = np.linalg.lstsq(values[:, rest], values[:, k], rcond=None)
        left = values[:, k] - values[:, rest] @ weights
        share = float(left @ left) / power
        terms = " ".join(f"{w:+.2g} {names[j]}" for w, j in zip(weights, rest, strict=True) if abs(w) > 0.05)
        if len(rest) > 1 and share < 1.0 - _COLLINEAR:
            what = f"{names[k]} = {terms} always: a control law moves them together, they cannot be separated"
            mend = "inject dither or other excitation on each, or leave one out"
            yield Finding(DOUBTFUL, "dependent", f"inputs.{_EFFECTORS}{names[k]}", what, mend)
            return
        alone = np.sqrt(float(left @ left) / count)
        if share < 1.0 - _TOGETHER and alone < _QUIET and (nearest is None or share < nearest[0]):
            what = f"{names[k]} = {terms} but for {np.degrees(alone):.2g} deg rms"
            nearest = share, f"inputs.{_EFFECTORS}{names[k]}", what
    if nearest is not None:
        _, where, what = nearest
        what += ": what each does alone, and its loss, is known by that motion, if it is more than noise of the sensor"
        yield Finding(NOTE, "together", where, what)


def check_sizes(record: Record, reference_speed: float) -> Iterator[Finding]:
    """Yield states and accelerations of a strange size: degrees for radians, another unit of speed or force."""
    for name, series in record.series.items():
        where, values = f"inputs.{name}", series.values
        leaf = name.removeprefix("states.")
        if leaf in ("P", "Q", "R", "angular_velocity"):
            top = float(np.quantile(np.abs(values), 0.99))
            if top > 12.0:
                what = f"turns with {top:.3g} rad/s, {np.degrees(top):.0f} deg/s: degrees taken as radians?"
                yield Finding(WRONG, "units", where, what, f"scale={np.pi / 180.0 * series.stream.scale[0]:.6g}")
        elif leaf in ("Phi", "Theta") and float(np.quantile(np.abs(values), 0.99)) > 3.2:
            what = f"reaches {np.abs(values).max():.3g} rad: degrees taken as radians?"
            yield Finding(WRONG, "units", where, what, f"scale={np.pi / 180.0 * series.stream.scale[0]:.6g}")
        elif name in ("alpha", "beta"):
            top = float(np.quantile(np.abs(values), 0.99))
            if top > 1.6:
                what = f"reaches {top:.3g} rad, {np.degrees(top):.0f} deg: degrees taken as radians?"
                yield Finding(WRONG, "units", where, what, f"scale={np.pi / 180.0 * series.stream.scale[0]:.6g}")
        elif name == "specific_force":
            yield from _force(where, values)
        elif name in ("velocity", "airspeed", "states.u"):
            yield from _speed(where, values, reference_speed)
    places = {"the accelerometer": record.inputs.imu_position, "the vanes": record.inputs.vane_position}
    for (name, place), entry in zip(places.items(), ("imu_position", "vane_position"), strict=True):
        far = max(map(abs, place))
        if far > 50.0:
            what = f"{name} would be {far:g} m from the centre of mass"
            yield Finding(WRONG, "units", f"inputs.{entry}", what, "give it in metres")


def _force(where: str, values: Array) -> Iterator[Finding]:
    size = float(np.median(np.linalg.norm(values, axis=1)))
    if 0.5 < size < 2.0:
        what = f"its size is {size:.3g} in the median: in g, not in m/s^2"
        yield Finding(WRONG, "units", where, what, "scale=9.80665")
    elif size > 40.0:
        what = f"its size is {size:.3g} m/s^2 in the median; at rest an accelerometer shows 9.81"
        yield Finding(WRONG, "units", where, what, f"scale={9.80665 / size:.3g}, if that is its unit")


def speed_of_flight(values: Array) -> float:
    """Return the median speed of what is faster than half of the fastest twentieth: a log may begin and end at rest.

    Parameters
    ----------
    values
        (n, 1) speeds or (n, 3) velocities [m/s].
    """
    speeds = np.linalg.norm(values, axis=1)
    return float(np.median(speeds[speeds >= 0.5 * np.quantile(speeds, 0.95)]))


def _speed(where: str, values: Array, reference: float) -> Iterator[Finding]:
    speed = speed_of_flight(values)
    if speed > 0.0 and not SPEEDS[0] < speed / reference < SPEEDS[1]:
        what = f"flies at {speed:.3g} m/s in the median, reference_speed is {reference:g} m/s"
        mend = f"reference_speed: {float(f'{speed:.2g}'):g}, where the speed is right"
        near = [n for n, s in UNITS_OF_SPEED.items() if abs(np.log(s * speed / reference)) < _NEAR]
        mend += "".join(f", or scale={UNITS_OF_SPEED[n]:.6g} in its line, where it is in {n}" for n in near)
        if not _FLIES[0] < speed < _FLIES[1]:
            mend = "no aircraft flies so: check scale and unit in its line"
            mend += "".join(f"; scale={UNITS_OF_SPEED[n]:.6g}, where it is in {n}" for n in near)
        yield Finding(DOUBTFUL, "reference_speed", where, what, mend)
    if speed < _FLIES[0]:
        yield Finding(NOTE, "speed", where, f"flies at {speed:.3g} m/s in the median: hardly any air loads")
