"""What a sample can teach: the present energy of each output against the energy that it had when it was excited.

In quiet flight the regressors are noise: forgetting then only loses what is known, and judging then only rewards having
no effect. So forgetting of held members and the weight of a sample in the evidence go with::

    mean <- slow mean of y,   now <- mean of (y - mean)^2 over half a second
    gate  = min(now / remembered, 1)
    remembered += gain gate (now - remembered);   rises at once with now

The energy that is remembered fades only as fast as flight is excited: after a minute of quiet it still knows the last
manoeuvre. It also makes the floor of the detector (`bank_detection`).
"""

from __future__ import annotations

from msls_ros.estimation.bank_state import BankSettings, BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array


@compiled
def observe_energy(s: BankSettings, x: BankState, y: Array) -> None:
    """Update energies and gates of all rows with the outputs of a sample, (r,)."""
    start = 1.0 / (x.samples[0] + 1.0)
    for q in range(y.shape[0]):
        x.mean[q] += max(start, s.energy[0]) * (y[q] - x.mean[q])
        deviation = y[q] - x.mean[q]
        x.now[q] += max(start, s.energy[1]) * (deviation * deviation - x.now[q])
        now = x.now[q]
        gate = now / x.remembered[q] if x.remembered[q] > now else 1.0
        x.remembered[q] += max(start, s.energy[2]) * gate * (now - x.remembered[q])
        if now > x.remembered[q]:
            x.remembered[q] += s.energy[3] * (now - x.remembered[q])
        x.gate[q] = gate
    for g in range(x.age.shape[0]):
        total = 0.0
        rows = 0
        for q in range(y.shape[0]):
            if x.group[q] == g:
                total += x.gate[q]
                rows += 1
        x.shared_gate[g] = total / rows if rows > 0 else 1.0
