"""One parameter after each of many samples, and nothing else: to compare estimators on the samples of another's flight.

`Identifier.run` gives the same numbers with everything around them, at ten times the cost.
"""

from __future__ import annotations

import numpy as np

from msls_ros.estimation.errors import EstimationError
from msls_ros.estimation.identifier import Identifier
from msls_ros.estimation.kernel import Array
from msls_ros.estimation.kinematics import build_regression


class Tracer(Identifier):
    """An identifier that tells one parameter.

    Parameters
    ----------
    configuration
        All parameters; see `Configuration`.
    """

    def trace(self, time: Array, x: Array, xdot: Array, delta: Array, row: str, column: str) -> Array:
        """Start anew, take samples, and return a parameter after each of them (k,).

        Parameters
        ----------
        time, x, xdot, delta
            As `Identifier.run` takes them.
        row, column
            The equation of a state, and a regressor.

        Raises
        ------
        EstimationError
            As `Identifier.run`, and for a parameter that is not identified.
        """
        c = self.configuration
        if row not in c.rows or column not in c.regressors:
            message = f"{row}/{column} is not identified; expected one of {c.rows} over one of {c.regressors}"
            raise EstimationError(message)
        self._check(time, x, xdot, delta)
        self.reset()
        phi, y = np.empty((len(time), len(c.regressors))), np.empty((len(time), len(c.rows)))
        x, xdot, delta = (np.ascontiguousarray(v, np.float64) for v in (x, xdot, delta))
        build_regression(x, xdot, delta, self._kept, self._forces, self._attitude, phi, y)
        history = self._regression.trace(phi, y, c.rows.index(row), c.regressors.index(column))
        self.reset()
        return history
