"""The true A(t) and B(t): central differences of the equations of motion about the present instant.

A second model, the twin, is put at the state, deflections, throttle and damage of the flying one and moved a
little in each of its 9 states and 7 effectors (eq 24). Its actuators are ideal, so a command is a deflection. It never
integrates, and the flying model is only read.
"""

from __future__ import annotations

import numpy as np

from msls_ros.plant.conditions import FlightCondition
from msls_ros.plant.interface import EFFECTORS, STATES, Array, LinearTruth, Sample
from msls_ros.plant.model import FOOT, Model, Surroundings

_STEPS = np.array([FOOT] * 3 + [0.01] * 3 + [0.005] * 3 + [0.005] * 7)


class Twin:
    """The second model, for one loading.

    Parameters
    ----------
    condition : FlightCondition
        Loading and leading-edge flap.
    """

    def __init__(self, condition: FlightCondition) -> None:
        self._model = Model(condition, 100, ideal=True)

    def derivative(self, sample: Sample, surroundings: Surroundings) -> Array:
        """Time derivatives (9,) at a sample's states and deflections, as the twin computes them."""
        self._model.surround(surroundings)
        return self._at(np.concatenate((sample.x, sample.delta)))

    def tangent(self, sample: Sample, surroundings: Surroundings) -> LinearTruth:
        """Linear model about a sample.

        Parameters
        ----------
        sample : Sample
            States and measured deflections.
        surroundings : Surroundings
            Place, throttle and damage of the same instant.

        Returns
        -------
        LinearTruth
            Differences over +-1 ft/s, +-0.01 rad/s, +-0.005 rad.
        """
        point = np.concatenate((sample.x, sample.delta))
        xdot = self.derivative(sample, surroundings)
        jacobian = np.empty((len(STATES), len(STATES) + len(EFFECTORS)))
        for i, step in enumerate(_STEPS):
            moved = point.copy()
            moved[i] = point[i] + step
            forward = self._at(moved)
            moved[i] = point[i] - step
            jacobian[:, i] = (forward - self._at(moved)) / (2.0 * step)
        a, b = jacobian[:, : len(STATES)].copy(), jacobian[:, len(STATES) :].copy()
        bias = xdot - (a * sample.x).sum(axis=1) - (b * sample.delta).sum(axis=1)
        return LinearTruth(sample.time, a, b, bias)

    def _at(self, point: Array) -> Array:
        values = point.tolist()
        self._model.put(values[: len(STATES)], values[len(STATES) :])
        return self._model.derivative()
