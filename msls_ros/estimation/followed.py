"""One estimate that is reported after every sample: which one, what is known of it, and its last value."""

from __future__ import annotations

from msls_ros.estimation.configuration import Configuration
from msls_ros.estimation.errors import EstimationError
from msls_ros.estimation.kernel import Array
from msls_ros.estimation.kinematics import find_rotation


class Followed:
    """Says which estimate is followed, and adds to it what is known from physics.

    Parameters
    ----------
    configuration
        Names of rows, states and regressors.
    """

    def __init__(self, configuration: Configuration) -> None:
        """Follow none; see the class."""
        self._configuration = configuration
        self.place = -1, -1
        """Row and regressor; negative: none."""
        self.last = 0.0
        """Its value after the last sample."""
        self._turned = -1, 0.0
        """What of it is known: state and its factor; see `find_rotation`."""

    def choose(self, row: str, column: str) -> None:
        """Follow another one, by the names of its row and its regressor; see `Identifier.follow`."""
        c = self._configuration
        if row not in c.rows or column not in c.regressors:
            message = (
                f"d{row}/dt by {column} is not identified; rows are {', '.join(c.rows)}, columns "
                f"{', '.join(c.regressors)}"
            )
            raise EstimationError(message)
        self.place = c.rows.index(row), c.regressors.index(column)
        source, factor = (find_rotation(c.rows) if c.known_rotation else {}).get(self.place, (-1, 0.0))
        self._turned = c.states.index(c.rows[source]) if factor else -1, factor

    def read(self, theta: Array) -> None:
        """Take it from all estimates, (r, p)."""
        self.last = float(theta[self.place])

    def report(self, estimates: Array, x: Array) -> Array:
        """Return it after each of k samples, (k,), with what is known of it at their states, (k, n)."""
        source, factor = self._turned
        if factor != 0.0:
            estimates = estimates + factor * x[:, source]
        self.last = float(estimates[-1])
        return estimates
