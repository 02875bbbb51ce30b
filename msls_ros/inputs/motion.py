"""Attitude, rates, velocity and accelerometer of a log against each other, under any reading of their frames and units.

The equations are those of a rigid body over a flat earth, integrated over a window so that nothing need be
differentiated twice; with R the matrix from forward-right-down to north-east-down::

    turn(R(t), R(t+h)) / h = mean of omega                      rates
    (R v (t+h) - R v (t)) / h = mean of (R f) + g               force
    mean of (R f) over the whole flight = -g                    weight
    R' v, less the wind, points ahead                           heading
    the belly points down                                       upright

"axis" is "force" along one axis of the aircraft, where the others hide it, without gravity, which turns along with it.
"size" is the logarithm of the ratio of the two sides of "force", where they are the same but for it. Where true
airspeed and the angles of vanes are mapped, v is that of the air, moved from the vanes to the centre of mass.

The misfit of an equation is ``2 |a - b|^2 / (|a|^2 + |b|^2)``: 0 where both sides agree, 2 where they have nothing to
do with each other, 4 where the sign is wrong. What white noise makes of it is taken off: its variance is that of the
third differences of attitude, velocity, rates and forces, in which a motion hardly shows. Where noise makes up more
than half of both sides they are compared over the longer window, or not at all.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from msls_ros.estimation.kernel import Array
from msls_ros.estimation.kinematics import GRAVITY
from msls_ros.inputs.frames import BODY, EARTH
from msls_ros.inputs.windows import beyond_noise, mean_squares, third_differences, windowed

_WINDOW, _LONG = 0.2, 0.8
"""Over which turns, and changes of velocity, are taken [s]."""
_CLEAR = 0.8
"""Correlation from which two signals are the same but for their size."""
_TURNING = 0.02
"""Rates below this rms show nothing [rad/s]."""
_MOVING = 0.4
"""Accelerations below this rms show nothing [m/s^2]."""
_ALONG = 0.6
"""The same, along one axis [m/s^2]."""
_FLYING = 3.0
"""Speed from which an aircraft is expected to move ahead [m/s]."""

SIGNALS = ("quaternion", "euler", "rates", "velocity", "force", "airspeed", "alpha", "beta", "wind")
"""What a `Motion` holds."""


@dataclass(frozen=True)
class Reading:
    """How the raw numbers of a log are read."""

    attitude_body: str = "frd"
    attitude_earth: str = "ned"
    order: tuple[int, ...] = (0, 1, 2, 3)
    """Places of w, x, y, z among the four numbers."""
    conjugate: bool = False
    attitude_scale: tuple[float, ...] = (1.0, 1.0, 1.0)
    """Of Euler angles that are mapped one by one."""
    attitude_axes: tuple[int, ...] = (0, 1, 2)
    """Places of Phi, Theta, Psi among those."""
    rates_frame: str = "frd"
    rates_axes: tuple[int, ...] = (0, 1, 2)
    rates_scale: tuple[float, ...] = (1.0, 1.0, 1.0)
    velocity_frame: str = "frd"
    """Of `BODY` or `EARTH`."""
    velocity_scale: float = 1.0
    air_scale: tuple[float, ...] = (1.0, 1.0, 1.0)
    """Of airspeed, alpha, beta."""
    air_axes: tuple[int, ...] = (0, 1, 2)
    """Places of airspeed, alpha, beta among the three."""
    vane_scale: float = 1.0
    """Of the place of the vanes."""
    wind_scale: float = 1.0
    wind_axes: tuple[int, ...] = (0, 1, 2)
    force_frame: str = "frd"
    force_axes: tuple[int, ...] = (0, 1, 2)
    force_scale: tuple[float, ...] = (1.0, 1.0, 1.0)
    weightless: bool = False
    """Gravity has been taken off the accelerometer."""

    def but(self, **changes: object) -> Reading:
        """Return another reading."""
        return replace(self, **changes)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Motion:
    """Raw numbers at common instants; k of them. What the log does not have is None."""

    step: float
    """[s]"""
    quaternion: Array | None = None
    """(k, 4) in the order of the messages."""
    euler: Array | None = None
    """(k, 3) Phi, Theta, Psi, where they are mapped one by one."""
    rates: Array | None = None
    velocity: Array | None = None
    force: Array | None = None
    """(k, 3)"""
    airspeed: Array | None = None
    alpha: Array | None = None
    beta: Array | None = None
    """(k, 1), all three in place of a velocity; or an airspeed beside it."""
    vane: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where those are measured, from the centre of mass, FRD [m]."""
    wind: Array | None = None
    """(k, 3) of the air over ground, NED [m/s]."""
    apart: int = 2
    """Steps after which no sample of a log stands in both of two instants; 0: noise is left in."""

    def shifted(self, names: Container[str], steps: int) -> Motion:
        """Return the motion with some signals taken so many steps later than the others."""
        found: dict[str, Any] = {}
        for key in SIGNALS:
            value: Array | None = getattr(self, key)
            if value is not None:
                own = steps if key in names else 0
                least, most = min(0, steps), max(0, steps)
                found[key] = value[own - least : len(value) + own - most]
        return replace(self, **found)

    def misfits(self, reading: Reading, *, faint: bool = False) -> dict[str, float]:
        """Return the misfit of each equation that the log can show, by its name.

        Parameters
        ----------
        reading
            How the numbers are read.
        faint
            Whether "force", "size" and "heading" are also held where both sides are small, if they stand out of the
            noise: a reading that makes a velocity small enough leaves nothing else to compare.
        """
        turn = self._rotation(reading)
        if turn is None:
            return {}
        widths = [max(1, round(w / self.step)) for w in (_WINDOW, _LONG)]
        found = {"upright": 1.0 - float(turn[:, 2, 2].mean())}
        rates = self._body(self.rates, reading.rates_frame, reading.rates_scale, reading.rates_axes)
        if rates is not None:
            found.update(_rates(turn, rates, widths, self.step, self.apart))
        velocity = self._velocity(turn, reading, rates)
        force = self._body(self.force, reading.force_frame, reading.force_scale, reading.force_axes)
        if force is not None:
            pull = np.einsum("kij,kj->ki", turn, force)
            if reading.weightless:
                pull = pull - [0.0, 0.0, GRAVITY]
            mean = pull.mean(axis=0) + np.array([0.0, 0.0, GRAVITY])
            found["weight"] = float(np.linalg.norm(mean)) / GRAVITY
            if velocity is not None:
                least = 0.0 if faint else np.sqrt(3.0) * _MOVING
                tried = [_force(velocity, pull, width, self.step, self.apart, least) for width in widths]
                found.update(min((one for one in tried if one), key=lambda one: one["force"], default={}))
                found.update(_along(turn, velocity, pull, widths, self.step, self.apart))
        if velocity is not None:
            if self.wind is not None:
                velocity = velocity - reading.wind_scale * self.wind[:, list(reading.wind_axes)]
            speed = np.linalg.norm(velocity, axis=1)
            if float(np.median(speed)) > (0.0 if faint else _FLYING):
                ahead = np.einsum("ki,ki->k", turn[:, :, 0], velocity)
                found["heading"] = 1.0 - float(ahead.sum() / speed.sum())
        return found

    def turns(self, reading: Reading) -> tuple[Array, Array, Array, int] | None:
        """Return mean rates over the shorter window by attitude and as measured.

        Returns
        -------
        tuple or None
            Of the attitude and measured (l, 3), FRD [rad/s], the variance (3,) of white noise in those measured, and
            the steps of the window; None where either is not mapped, or there is less than four windows of them.
        """
        turn = self._rotation(reading)
        rates = self._body(self.rates, reading.rates_frame, reading.rates_scale, reading.rates_axes)
        width = max(2, round(_WINDOW / self.step))
        if turn is None or rates is None or len(turn) < 4 * width:
            return None
        noise = mean_squares(third_differences(rates, self.apart)) * min(1.0, 0.5 * self.apart / width)
        return turned(turn, width, self.step), windowed(rates, width), noise, width

    def pulls(self, reading: Reading) -> tuple[Array, Array, Array, Array, int] | None:
        """Return mean specific forces over the shorter window by velocity and as felt, along the aircraft's axes.

        Returns
        -------
        tuple or None
            Of the velocity and felt (l, 3), FRD [m/s^2], mean angular accelerations (l, 3) [rad/s^2], the variance (3,)
            of white noise in those felt, and the steps of the window; None where one of them is not mapped, or there is
            less than four windows of them.
        """
        turn = self._rotation(reading)
        rates = self._body(self.rates, reading.rates_frame, reading.rates_scale, reading.rates_axes)
        force = self._body(self.force, reading.force_frame, reading.force_scale, reading.force_axes)
        width = max(2, round(_WINDOW / self.step))
        velocity = None if turn is None else self._velocity(turn, reading, rates)
        if turn is None or rates is None or force is None or velocity is None or len(turn) < 4 * width:
            return None
        over = width * self.step
        middle = turn[width // 2 :][: len(turn) - width]
        change = (velocity[width:] - velocity[:-width]) / over - [0.0, 0.0, GRAVITY]
        sides = change, windowed(np.einsum("kij,kj->ki", turn, force), width)
        shown, felt = (np.einsum("kji,kj->ki", middle, side) for side in sides)
        noise = mean_squares(third_differences(force, self.apart)) * min(1.0, 0.5 * self.apart / width)
        return shown, felt, (rates[width:] - rates[:-width]) / over, noise, width

    def air_velocity(self, reading: Reading) -> Array | None:
        """Return the velocity less the wind (k, 3) along the axes of the aircraft, FRD [m/s]."""
        turn = self._rotation(reading)
        velocity = None if turn is None else self._velocity(turn, reading, None)
        if turn is None or velocity is None:
            return None
        return np.asarray(np.einsum("kji,kj->ki", turn, velocity if self.wind is None else velocity - self.wind))

    def air_speed(self, reading: Reading) -> Array | None:
        """Return the size (k,) of the velocity less the wind [m/s]."""
        turn = self._rotation(reading)
        velocity = None if turn is None else self._velocity(turn, reading, None)
        if velocity is None:
            return None
        return np.asarray(np.linalg.norm(velocity if self.wind is None else velocity - self.wind, axis=1))

    def _rotation(self, reading: Reading) -> Array | None:
        """Return the matrices (k, 3, 3) from FRD to NED."""
        if self.quaternion is not None:
            matrix = _matrices(self.quaternion[:, list(reading.order)], reading.conjugate)
            rows = np.zeros((3, 3))
            for i, (place, sign) in enumerate(EARTH[reading.attitude_earth]):
                rows[i, place] = sign
            return np.asarray(rows @ matrix * BODY[reading.attitude_body])
        if self.euler is None:
            return None
        angles = (self.euler[:, list(reading.attitude_axes)] * reading.attitude_scale).T
        (sp, st, ss), (cp, ct, cs) = (f(angles) for f in (np.sin, np.cos))
        return np.stack(
            [
                np.stack([ct * cs, sp * st * cs - cp * ss, cp * st * cs + sp * ss], axis=1),
                np.stack([ct * ss, sp * st * ss + cp * cs, cp * st * ss - sp * cs], axis=1),
                np.stack([-st, sp * ct, cp * ct], axis=1),
            ],
            axis=1,
        )

    def _body(
        self, raw: Array | None, frame: str, scale: tuple[float, ...], axes: tuple[int, ...] = (0, 1, 2)
    ) -> Array | None:
        if raw is None:
            return None
        return np.asarray(raw[:, list(axes)] * scale * BODY[frame])

    def _velocity(self, turn: Array, reading: Reading, rates: Array | None) -> Array | None:
        """Return the velocity (k, 3) in NED."""
        if self.airspeed is not None and self.alpha is not None and self.beta is not None:
            air = np.concatenate([self.airspeed, self.alpha, self.beta], axis=1)[:, list(reading.air_axes)]
            body = air_velocities(air * reading.air_scale)
            if rates is not None and any(self.vane):
                body = body - np.cross(rates, np.array(self.vane) * reading.vane_scale)
            return np.asarray(np.einsum("kij,kj->ki", turn, body))
        if self.velocity is None:
            return None
        raw = self.velocity * reading.velocity_scale
        if reading.velocity_frame in EARTH:
            return np.stack([sign * raw[:, place] for place, sign in EARTH[reading.velocity_frame]], axis=1)
        return np.asarray(np.einsum("kij,kj->ki", turn, raw * BODY[reading.velocity_frame]))


def _matrices(quaternion: Array, conjugate: bool) -> Array:
    """Return the rotation matrices (k, 3, 3) of quaternions, w first."""
    w, x, y, z = (quaternion / np.linalg.norm(quaternion, axis=1)[:, None]).T
    if conjugate:
        x, y, z = -x, -y, -z
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=1),
        ],
        axis=1,
    )


def air_velocities(air: Array) -> Array:
    """Return u, v, w (k, 3) of rows of airspeed, alpha, beta; see `frames.air_velocity`."""
    (speed, alpha, beta) = air.T
    ahead = speed * np.cos(beta)
    return np.stack([ahead * np.cos(alpha), speed * np.sin(beta), ahead * np.sin(alpha)], axis=1)


def turned(turn: Array, width: int, step: float) -> Array:
    """Return the mean rates (k - width, 3) [rad/s] that an attitude shows over windows of so many steps."""
    between = np.einsum("kji,kjl->kil", turn[:-width], turn[width:])
    vector = 0.5 * np.stack(
        [
            between[:, 2, 1] - between[:, 1, 2],
            between[:, 0, 2] - between[:, 2, 0],
            between[:, 1, 0] - between[:, 0, 1],
        ],
        axis=1,
    )
    sine = np.linalg.norm(vector, axis=1)
    angle = np.arctan2(sine, 0.5 * (np.trace(between, axis1=1, axis2=2) - 1.0))
    factor = np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 1.0)
    return np.asarray(vector * factor[:, None] / (width * step))


def _rates(turn: Array, rates: Array, widths: Sequence[int], step: float, apart: int) -> Mapping[str, float]:
    """Return the misfit about each axis, of the first window in which it stands out of the noise."""
    second = np.zeros((0, 3))
    if apart:
        little = apart * step * turned(turn, apart, step)
        second = little[2 * apart :] - 2.0 * little[apart:-apart] + little[: -2 * apart]
    angle, gyro = mean_squares(second) / 20.0, mean_squares(third_differences(rates, apart))
    found: dict[str, float] = {}
    hidden = dict(enumerate("PQR"))
    for width in widths:
        sides = turned(turn, width, step), windowed(rates, width)
        seen, measured = (side - side.mean(axis=0) for side in sides)
        noise = 2.0 * angle / (width * step) ** 2, gyro * min(1.0, 0.5 * apart / width)
        for i, name in list(hidden.items()):
            axis = slice(i, i + 1)
            one = beyond_noise(seen[:, axis], measured[:, axis], (noise[0][axis], noise[1][axis]))
            if one is not None:
                del hidden[i]
                if max(one[1:]) > _TURNING:
                    found[f"rates {name}"] = one[0]
    return dict(sorted(found.items()))


def _force(velocity: Array, pull: Array, width: int, step: float, apart: int, least: float) -> Mapping[str, float]:
    """Return the misfit and the ratio of the two sides, where one of them is at least as large [m/s^2, rms]."""
    change = (velocity[width:] - velocity[:-width]) / (width * step)
    felt = windowed(pull, width)
    change, felt = change - change.mean(axis=0), felt - felt.mean(axis=0)
    moved, held = (mean_squares(third_differences(side, apart)) for side in (velocity, pull))
    noise = 2.0 * moved / (width * step) ** 2, held * min(1.0, 0.5 * apart / width)
    one = beyond_noise(change, felt, noise)
    if one is None or max(one[1:]) <= least:
        return {}
    same = min(one[1:]) > 0.0 and float((change * felt).sum()) > _CLEAR * one[1] * one[2] * len(felt)
    return {"force": one[0], **({"size": abs(float(np.log(one[1] / one[2])))} if same else {})}


def _along(
    turn: Array, velocity: Array, pull: Array, widths: Sequence[int], step: float, apart: int
) -> Mapping[str, float]:
    """Return the misfits along the axes of the aircraft that all windows show, the smallest.

    Both sides are specific forces: gravity, constant in the frame of the earth, turns with the aircraft along its axes.
    A window in which noise hides an axis has no say.
    """
    found: dict[str, list[float]] = {name: [] for name in "XYZ"}
    calm: set[str] = set()
    third = third_differences(velocity, apart)
    shaken = np.einsum("kji,kj->ki", turn[apart:][: len(third)], third)
    speed, force = mean_squares(shaken), mean_squares(third_differences(np.einsum("kji,kj->ki", turn, pull), apart))
    for width in widths:
        change = (velocity[width:] - velocity[:-width]) / (width * step) - [0.0, 0.0, GRAVITY]
        middle = turn[width // 2 :][: len(change)]
        sides = [np.einsum("kji,kj->ki", middle, side) for side in (change, windowed(pull, width))]
        a, b = (side - side.mean(axis=0) for side in sides)
        noise = 2.0 * speed / (width * step) ** 2, force * min(1.0, 0.5 * apart / width)
        for i, name in enumerate("XYZ"):
            axis = slice(i, i + 1)
            one = beyond_noise(a[:, axis], b[:, axis], (noise[0][axis], noise[1][axis]))
            if one is not None and max(one[1:]) > _ALONG:
                found[name].append(one[0])
            elif one is not None:
                calm.add(name)
    return {f"axis {name}": min(values) for name, values in found.items() if values and name not in calm}
