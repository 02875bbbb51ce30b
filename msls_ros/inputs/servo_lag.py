"""What a servo of first order makes of the commands that it holds between their stamps.

Between two commands the deflection y goes to the earlier one, u, which is held: after a time h it is
``y + (1 - exp(-h/T)) (u - y)``, without an error of discretisation at any step. It begins at the first command, and
anew after a gap, as what was commanded in between is not known.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation.elementary import exponential
from msls_ros.estimation.kernel import Array


class ServoLag:
    """Turn commands into the deflections at their stamps.

    Parameters
    ----------
    lag
        Time constant [s], more than 0.
    longest
        Step between commands beyond which it begins anew [ns].
    """

    def __init__(self, lag: float, longest: int) -> None:
        """Know of no command yet; see the class."""
        self._rate, self._longest = 1e-9 / lag, longest
        self.clear()

    def clear(self) -> None:
        """Forget the deflection: the next command is the first."""
        self._last: int | None = None
        self._command = self._deflection = 0.0

    def take(self, stamp: int, command: float) -> float:
        """Take a command and its stamp [ns], which is later than those before; return the deflection then."""
        step = 0 if self._last is None else stamp - self._last
        if 0 < step <= self._longest:
            self._deflection += (1.0 - exponential(-step * self._rate)) * (self._command - self._deflection)
        else:
            self._deflection = command
        self._last, self._command = stamp, command
        return self._deflection


def followed(stamps: NDArray[np.int64], commands: Array, lag: float, longest: int) -> Array:
    """Return the deflections (k,) of commands (k,) at their stamps [ns], as `ServoLag` does; a lag of 0 leaves them."""
    if lag <= 0.0:
        return commands
    servo = ServoLag(lag, longest)
    return np.array([servo.take(t, u) for t, u in zip(stamps.tolist(), commands.tolist(), strict=True)])
