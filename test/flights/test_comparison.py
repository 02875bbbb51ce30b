"""What a pilot feels of the dither: the acceleration of a point of a rigid body."""

from __future__ import annotations

import numpy as np

from msls_ros.estimation.kernel import Array
from msls_ros.flights.comparison import GRAVITY, realised_acceleration
from msls_ros.plant import F16_MATV


def test_what_is_felt_is_the_acceleration_of_a_point_ahead_of_and_above_the_centre_of_mass() -> None:
    rng = np.random.default_rng(0)
    n, m = 400, len(F16_MATV.effectors)
    b = rng.standard_normal((9, m))
    held: Array = 0.01 * rng.standard_normal(m)
    felt = realised_acceleration(0.02 * np.arange(n, dtype=np.float64), np.tile(held, (n, 1)), np.tile(b, (n, 1, 1)))
    linear, angular = b[:3] @ held, b[3:6] @ held
    ahead, above = F16_MATV.station
    expected = (linear + np.cross(angular, [ahead, 0.0, -above])) / GRAVITY
    np.testing.assert_allclose(felt[-1], expected, rtol=1e-6)
