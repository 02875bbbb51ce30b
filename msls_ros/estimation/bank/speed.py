"""Effects go with airspeed: what is learnt at one speed holds at others.

Aerodynamic forces and moments of an aircraft at constant density go with dynamic pressure, and what rates and
velocities make of them goes with the angles that they are, ``alpha = w/V`` and ``P b/2V`` (Etkin)::

    xdot_q = theta_1 + sum_i s^e_i theta_i phi_i,     s = V/V_ref,   e = 1 of states, 2 of surfaces, 0 of thrust

so the bank regresses on ``s^e phi`` and knows ``theta`` at the speed ``V_ref`` of its first sample, where all else is
as before. What is handed out is the tangent at a state x of speed V, with ``S = sum_i e_i theta_i s^e_i phi_i``::

    A_qi = s theta_i + (x_i/V^2) S  (the latter for u, v, w),     B_qj = s^e_j theta_j,     bias_q = theta_1 - S

for ``d s^e / d u = e s^e u/V^2``. Of the three velocities' errors those of S are part, as if they were independent.
The constant does not go with speed: it walks. Density, thrust, slipstream and compressibility are not in it: how far
they may matter is in the error bars (`bank.uncertainty.SPEED_STATES`).

References
----------
Etkin and Reid, *Dynamics of Flight: Stability and Control*, 3rd ed., 1996, section 4.14 (dimensional derivatives).
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array, Integers

SLOWEST, FASTEST = 0.25, 4.0
"""Least and largest s that is reckoned with: beyond it effects stay as they are there [1]."""


@compiled
def scale_regressors(s: BankSettings, x: BankState, phi: Array) -> None:
    """Multiply the regressors (p,), constant first, by their power of the speed of this sample."""
    if s.scaled:
        speed = speed_of(s, phi)
        if x.speed[0] == 0.0:
            x.speed[0] = max(speed, SLOWEST * s.speed[0])
        x.speed[1] = min(max(speed / x.speed[0], SLOWEST), FASTEST)
        raise_regressors(s, phi, x.speed[1])
    for i in range(phi.shape[0]):
        x.seen[i] = phi[i]


@compiled
def speed_of(s: BankSettings, phi: Array) -> float:
    """Return the size of the velocity among the regressors (p,), constant first [m/s]."""
    square = 0.0
    for j in range(s.velocities.shape[0]):
        square += phi[s.velocities[j]] * phi[s.velocities[j]]
    return math.sqrt(square)


@compiled
def raise_regressors(s: BankSettings, phi: Array, ratio: float) -> None:
    """Multiply the regressors (p,), constant first, by their power of a ratio of speeds."""
    for i in range(phi.shape[0]):
        phi[i] *= power_of(s, i, ratio)


@compiled
def power_of(s: BankSettings, i: int, ratio: float) -> float:
    """Return by what coefficient i (constant first) is larger at so many times the speed [1]."""
    e = s.exponent[i]
    return ratio * ratio if e == 2 else ratio if e == 1 else 1.0


@compiled
def ratio_of(x: BankState) -> float:
    """Return the speed of the last sample over that at which the estimates hold; 1 where they hold at all [1]."""
    return float(x.speed[1]) if x.speed[1] > 0.0 else 1.0


@compiled
def seen_at(s: BankSettings, x: BankState, state: Array, kept: Integers, phi: Array) -> float:
    """Fill in the regressors at a state, with the last sample's deflections, and return the ratio of speeds there.

    Parameters
    ----------
    s, x
        Settings and state.
    state
        (n,) [m/s, rad/s, rad].
    kept
        (r,) which of them are regressors.
    phi
        (p,) out, constant first, scaled as `scale_regressors` does.
    """
    before = ratio_of(x)
    phi[0] = 1.0
    for i in range(kept.shape[0]):
        phi[i + 1] = state[kept[i]]
    for i in range(kept.shape[0] + 1, phi.shape[0]):
        phi[i] = x.seen[i] / power_of(s, i, before)
    if not s.scaled:
        return 1.0
    speed = speed_of(s, phi)
    ratio = min(max(speed / x.speed[0], SLOWEST), FASTEST) if x.speed[0] > 0.0 else 1.0
    raise_regressors(s, phi, ratio)
    return float(ratio)


@compiled
def slope_by_speed(s: BankSettings, phi: Array, i: int, ratio: float) -> float:
    """Return ``x_i/V^2`` of a velocity i among the regressors (p,), constant first, scaled; 0 of all others."""
    if not s.scaled:
        return 0.0
    for j in range(s.velocities.shape[0]):
        if s.velocities[j] == i:
            speed = speed_of(s, phi) / ratio
            return float(phi[i] / (ratio * max(speed * speed, 1.0e-12)))
    return 0.0


@compiled
def goes_with_speed(s: BankSettings, theta: Array, phi: Array) -> float:
    """Return S of estimates (p,) and regressors (p,), constant first, scaled [output]."""
    total = 0.0
    for i in range(1, phi.shape[0]):
        total += s.exponent[i] * theta[i] * phi[i]
    return total


@compiled
def value_at(s: BankSettings, theta: Array, phi: Array, i: int, ratio: float) -> float:
    """Return the derivative by regressor i, or for 0 the bias, of estimates (p,), constant first, at a speed.

    ``phi`` are the scaled regressors there, (p,).
    """
    if i == 0:
        return float(theta[0] - (goes_with_speed(s, theta, phi) if s.scaled else 0.0))
    value = power_of(s, i, ratio) * theta[i]
    slope = slope_by_speed(s, phi, i, ratio)
    return float(value + slope * goes_with_speed(s, theta, phi)) if slope != 0.0 else float(value)


@compiled
def fill_values(
    s: BankSettings, x: BankState, q: int, i: int, states: Array, kept: Integers, phi: Array, out: Array
) -> None:
    """Fill in row q's derivative by regressor i at states (k, n): (k,) out, scratch (p,); see `seen_at`."""
    for k in range(out.shape[0]):
        ratio = seen_at(s, x, states[k], kept, phi)
        out[k] = published_value(s, x, q, phi, i, ratio)


@compiled
def last_value(s: BankSettings, x: BankState, q: int, i: int) -> float:
    """Return row q's derivative by regressor i (constant first), or for 0 its bias, at the last sample."""
    return published_value(s, x, q, x.seen, i, ratio_of(x))


@compiled
def published_value(s: BankSettings, x: BankState, q: int, phi: Array, i: int, ratio: float) -> float:
    """As `value_at`, of row q's estimates as they are published (`bank.shrinkage`)."""
    value = value_at(s, x.mixed[q], phi, i, ratio)
    return float(value + value_at(s, x.shift[q], phi, i, ratio)) if x.drawn[q] else float(value)
