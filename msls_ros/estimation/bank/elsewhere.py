"""By how much a derivative may differ where the aircraft is elsewhere in the envelope than where it was learnt.

A derivative is a slope about a velocity vector, a speed and rates, and what is learnt of it holds there. Where the
aircraft is at another place, the square of what it may have changed is added to its variance (`bank.uncertainty`): in
proportion to the distance from the means over a member's memory, or from the place where it was known best.

Lift and drag keep their angles to the velocity and not to the body. Where the velocity has turned by an angle ``a`` in
the body's axes, the derivatives of the force have turned with it, of rows and of columns, ``dA = a (J A - A J)``,
``dB = a J B`` with J the turn by a right angle. What X by w changes by is ``a`` of Z by w, and no share of itself
(`turned_square`).

What is published of states and forces is for the velocity of its stamp, and ``place`` is the mean of half a second: in
a pull-up these are some degrees apart (`distance_from_place`). Effectors' moments go less with the angle of attack: of
a canard jet's B .996 was covered in manoeuvres either way.

References
----------
Etkin and Reid, *Dynamics of Flight: Stability and Control*, 3rd ed., 1996, section 4.13 (derivatives in other body
axes). Atkeson, Moore and Schaal, "Locally weighted learning", Artif. Intell. Rev. 11 (1997) (what is known is known
about where it was learnt).
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.speed import SLOWEST, power_of, ratio_of, speed_of
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.elementary import logarithm
from msls_ros.estimation.kernel import Array

REACH_STATES, REACH_EFFECTORS = 0.3, 0.65
"""Change of the velocity vector, as a share of the speed, at which a derivative may be off by its own size [1].

With .25 and .42, 95 % of the errors were within .5 to 1.2 of a bar that this dominates (seeds 845 and 205, as measured,
all beds but A of the F-16, 3.2); now .7 to 1.8.
"""
REACH_THROUGH = (0.25, 0.42)
"""The same through windows. Errors are smaller there, too, but the detector allows by the bars: with narrower ones a
whole flight with spikes (`benchmark calibration --whole`, measured, 25 Hz) has 4 false alarms, not 2.
"""
SPEED_STATES, SPEED_EFFECTORS = 1.0, 0.84
"""The same for a change of speed where effects go with it (`bank.speed`), as a share of the first one [1].

Where they do not, as a nozzle's, a derivative is off by as much as speed has changed, an effect by twice that: 1 and
1.7 of these.
"""


@compiled
def distance_from_mean(s: BankSettings, x: BankState, q: int, m: int) -> float:
    """Squared distance of the mean velocities of now from those that member m remembers, over their scales [1].

    Where effects go with airspeed, of the direction of the velocity alone.
    """
    centre = x.centre[x.group[q]]
    mean = mean_velocity(s, x, q, m)
    away = 0.0
    for j in range(s.velocities.shape[0]):
        unit = mean if s.scaled else s.speed[j]
        step = x.place[j] - (centre[s.velocities[j], m] / unit if unit > 0.0 else x.place[j])
        away += step * step
    return away


@compiled
def mean_velocity(s: BankSettings, x: BankState, q: int, m: int) -> float:
    """Size of the mean velocity that member m remembers, as a regressor [m/s]."""
    square = 0.0
    for j in range(s.velocities.shape[0]):
        one = x.centre[x.group[q], s.velocities[j], m]
        square += one * one
    return math.sqrt(square)


@compiled
def mean_ratio(s: BankSettings, x: BankState, q: int, m: int) -> float:
    """Ratio of speeds that member m remembers [1]: its velocity, a regressor, goes with the square of it."""
    if not s.scaled or x.speed[0] == 0.0:
        return 1.0
    return max(math.sqrt(mean_velocity(s, x, q, m) / x.speed[0]), SLOWEST)


@compiled
def speed_from_mean(s: BankSettings, x: BankState, q: int, m: int) -> float:
    """Squared logarithm of the mean speed of now over that which member m remembers [1]; 0 where it counts as place."""
    if not s.scaled:
        return 0.0
    step = logarithm(max(x.place[x.place.shape[0] - 1], SLOWEST) / mean_ratio(s, x, q, m))
    return step * step


@compiled
def elsewhere_square(s: BankSettings, value: float, i: int, away: float, apart: float) -> float:
    """Square by which coefficient i (constant first), known as ``value``, may differ at these squared distances."""
    effector = s.effectors_from < i <= s.effectors_to
    reach = REACH_EFFECTORS if effector else REACH_STATES
    if s.straddle > 0:
        reach = REACH_THROUGH[1] if effector else REACH_THROUGH[0]
    along = SPEED_EFFECTORS if effector else SPEED_STATES
    return value * value * (away / (reach * reach) + apart / (along * along))


@compiled
def turned_square(s: BankSettings, x: BankState, q: int, i: int, away: float) -> float:
    """Square by which coefficient i (constant first) of a force may differ where the velocity has turned, squared [1].

    A canard jet (10 t, 150 m/s, made up by others, not one of ours; 50 flights): 1889 of the 2505 numbers of A that
    were called reliable and wrong by more than four standard errors were X by w, -.085 +- .003 for -.009.
    """
    total = 0.0
    own = False
    column = False
    for j in range(s.velocities.shape[0]):
        k = s.velocities[j]
        own = own or k == q + 1
        column = column or k == i
    if not own or i == 0:
        return 0.0
    for j in range(s.velocities.shape[0]):
        k = s.velocities[j]
        if k != q + 1:
            total += x.mixed[k - 1, i] * x.mixed[k - 1, i]
        if column and k != i:
            total += x.mixed[q, k] * x.mixed[q, k]
    return away * total


@compiled
def distance_from_place(s: BankSettings, x: BankState, phi: Array) -> float:
    """Squared distance of the velocity in phi (p,), constant first, from its mean of lately, beyond noise [1]."""
    away = 0.0
    speed = speed_of(s, phi)
    for j in range(s.velocities.shape[0]):
        i = s.velocities[j]
        unit = speed if s.scaled else s.speed[j]
        if unit > 0.0:
            step = phi[i] / unit - x.place[j]
            away += max(step * step - x.white_noise[i - 1] / (unit * unit), 0.0)
    return away


@compiled
def turn_from_mean(s: BankSettings, x: BankState, q: int, rate: int, m: int) -> float:
    """Difference of a rate of now from the mean that member m remembers, as `distance_from_mean` [rad/s]."""
    mean = x.centre[x.group[q], s.rates[rate], m] / mean_ratio(s, x, q, m)
    return float(x.place[s.velocities.shape[0] + rate] - mean)


@compiled
def inertial_square(s: BankSettings, x: BankState, q: int, i: int, turn: float) -> float:
    """Square by which a derivative of an angular acceleration by another rate may differ, the third off by ``turn``.

    Euler's equation of rate a holds ``c_a`` times the product of the two others: the derivative by one of them is
    ``c_a`` times the other. With principal moments of inertia no larger than the sum of the two others, each c is
    within -1 and 1, of which a third is the mean square; where most of it is known (`kinematics.GYROSCOPIC_PITCH`) it
    is off by no more than that is from .5 and 1, or .2.
    """
    part = turn / power_of(s, i, ratio_of(x))
    return part * part * (0.04 if s.turning[q + 1, i] > 0 else 1.0 / 3.0)


@compiled
def speed_from_best(s: BankSettings, x: BankState, q: int, i: int) -> float:
    """As `speed_from_mean`, from where coefficient i of row q was known best; logarithms are kept for the next."""
    if not s.scaled:
        return 0.0
    last = x.place.shape[0] - 1
    ratio = max(x.place[last], SLOWEST) / max(x.best_place[q, i, last], SLOWEST)
    ratios, steps = x.speed_logarithm[0], x.speed_logarithm[1]
    if ratio != ratios[i]:
        steps[i] = steps[i - 1] if i > 0 and ratio == ratios[i - 1] else logarithm(ratio)
        ratios[i] = ratio
    return float(steps[i] * steps[i])
