"""What a surface does by itself, of the estimates of its effectors' columns, and the error of that."""

from __future__ import annotations

from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array


@compiled
def effect_of(s: BankSettings, theta: Array, k: int) -> float:
    """Effect of surface k by itself in a row with estimates (p,), constant first."""
    effect = 0.0
    for j in range(s.shares.shape[1]):
        effect += s.shares[k, j] * theta[s.effectors_from + 1 + j]
    return effect


@compiled
def square_of_effect(s: BankSettings, square: Array, k: int) -> float:
    """Squared standard error of that, of (p,) squared standard errors."""
    total = 0.0
    for j in range(s.shares.shape[1]):
        if s.shares[k, j] != 0.0:
            total += s.shares[k, j] * s.shares[k, j] * square[s.effectors_from + 1 + j]
    return total
