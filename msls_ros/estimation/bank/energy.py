"""What a sample can teach: the present energy of each output against the energy that it had when it was excited.

In quiet flight the regressors are noise: forgetting then only loses what is known, and judging then only rewards having
no effect. So forgetting of held members and the weight of a sample in the evidence go with::

    mean <- slow mean of y,   now <- mean of (y - mean)^2 over half a second
    gate  = min(now / remembered, 1)
    remembered += gain gate (now - remembered);   rises at once with now

Forgetting takes the mean gate of an axis, longitudinal or lateral: in a rudder input the gate of Q is .003, the mean of
all rows .3. The row of u does not count in it: speed changes by whatever an aircraft does.

The same for each regressor says whether it moves further than ever before. The energy that is remembered fades only as
fast as flight is excited: after a minute of quiet it still knows the last manoeuvre. It also makes the floor of the
detector (`bank.detection`).
"""

from __future__ import annotations

from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.speed import power_of, ratio_of
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

NEW = 9.0
"""A regressor is new to us where its squared deviation is so many times the energy that it is known by."""

FIRST = 25.0
"""It is excited for the first time in earnest where it is so many times that: five standard deviations of noise."""


@compiled
def observe_novelty(s: BankSettings, x: BankState, phi: Array) -> float:
    """Update the energies of the regressors; return by how much the largest exceeds all that was seen, at least 1.

    Parameters
    ----------
    s, x
        Settings and state.
    phi
        (p,) regressor, constant first.
    """
    start = 1.0 / (x.samples[0] + 1.0)
    novelty = 1.0
    if x.learning[0] > 0:
        x.learning[0] -= 1
    for i in range(1, phi.shape[0]):
        x.phi_mean[i] += max(start, s.energy[0]) * (phi[i] - x.phi_mean[i])
        deviation = phi[i] - x.phi_mean[i]
        now = deviation * deviation
        known = x.phi_remembered[i]
        if now > novelty * NEW * known and known > 0.0:
            novelty = now / (NEW * known)
        if now > FIRST * known and known > 0.0 and x.samples[0] > 0:
            x.learning[0] = s.learning
        gate = now / known if known > now else 1.0
        x.phi_remembered[i] += max(start, s.energy[2]) * gate * (now - known)
        if now > known:
            x.phi_remembered[i] += s.energy[3] * (now - x.phi_remembered[i])
    observe_steps(s, x, phi, start)
    return novelty


@compiled
def observe_steps(s: BankSettings, x: BankState, phi: Array, start: float) -> None:
    """As `observe_novelty` of how fast the effectors move: a step shows what a late or early record makes of it."""
    for i in range(s.effectors_from + 1, s.effectors_to + 1):
        step = phi[i] - x.phi_last[i] if x.samples[0] > 0 else 0.0
        now = step * step
        known = x.step_remembered[i]
        if now > FIRST * known and known > 0.0:
            x.learning[0] = s.learning
        gate = now / known if known > now else 1.0
        x.step_remembered[i] += max(start, s.energy[2]) * gate * (now - known)
        if now > known:
            x.step_remembered[i] += s.energy[3] * (now - x.step_remembered[i])
        x.phi_last[i] = phi[i]


@compiled
def turned_output(s: BankSettings, x: BankState, phi: Array, q: int) -> float:
    """Return what the turning of the body's axes makes of row q's output, as `kinematics.remove_rotation` took it off.

    It is a sum of products of two regressors: half of each regressor times its part of the tangent, for each counts
    twice.
    """
    total = 0.0
    ratio = ratio_of(x)
    for i in range(1, phi.shape[0]):
        source = s.turning[q + 1, i]
        if source > 0:
            scale = power_of(s, source, ratio) * power_of(s, i, ratio)
            total += 0.5 * s.turned[q + 1, i] * phi[source] * phi[i] / scale
    return total


@compiled
def observe_energy(s: BankSettings, x: BankState, phi: Array, y: Array) -> None:
    """Update energies and gates of all rows with regressors (p,), constant first, and outputs (r,) of a sample."""
    start = 1.0 / (x.samples[0] + 1.0)
    for q in range(y.shape[0]):
        output = y[q] + turned_output(s, x, phi, q)
        x.mean[q] += max(start, s.energy[0]) * (output - x.mean[q])
        deviation = output - x.mean[q]
        x.now[q] += max(start, s.energy[1]) * (deviation * deviation - x.now[q])
        now = x.now[q]
        gate = now / x.remembered[q] if x.remembered[q] > now else 1.0
        x.remembered[q] += max(start, s.energy[2]) * gate * (now - x.remembered[q])
        if now > x.remembered[q]:
            x.remembered[q] += s.energy[3] * (now - x.remembered[q])
        foreseen = output - y[q] - x.mean[q]
        for i in range(phi.shape[0]):
            foreseen += x.mixed[q, i] * phi[i]
        x.foreseen[q] += max(start, s.energy[1]) * (foreseen * foreseen - x.foreseen[q])
        x.gate[q] = max(gate, min(x.foreseen[q] / x.remembered[q], 1.0)) if x.remembered[q] > 0.0 else 1.0
    for g in range(x.age.shape[0]):
        for a in range(x.axis_gate.shape[1]):
            total = 0.0
            rows = 0
            for q in range(y.shape[0]):
                if x.group[q] == g and s.row_axis[q] == a and s.counts[q] == 1:
                    total += x.gate[q]
                    rows += 1
            x.axis_gate[g, a] = total / rows if rows > 0 else 1.0
