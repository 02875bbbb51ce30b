"""The true A(t) and B(t): central differences of the equations of motion about the present instant.

A second model, the twin, is put at the state, deflections, throttle and damage of the flying one and moved a
little in each of its 9 states and its effectors (eq 24). Its actuators are ideal, so a command is a deflection, and a
stability augmentation does not answer. It never integrates, and the flying model is only read.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from msls_ros.plant.conditions import FlightCondition
from msls_ros.plant.interface import STATES, Array, LinearTruth, Sample
from msls_ros.plant.model import FOOT, SI, Surroundings
from msls_ros.plant.stock import make_model

_STEPS = (*[FOOT] * 3, *[0.01] * 3, *[0.005] * 3)
_DEFLECTION = 0.005


class Twin:
    """The second model, for one loading.

    Parameters
    ----------
    condition : FlightCondition
        Loading and leading-edge flap.
    """

    def __init__(self, condition: FlightCondition) -> None:
        self._model = make_model(condition, max(100, condition.airframe.least_rate), ideal=True)

    def derivative(self, sample: Sample, surroundings: Surroundings) -> Array:
        """Time derivatives (9,) at a sample's states and deflections, as the twin computes them."""
        self._model.surround(surroundings)
        return self._at(sample.x.tolist(), sample.delta.tolist())

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
        self._model.surround(surroundings)
        x, delta = sample.x.tolist(), sample.delta.tolist()
        steps = (*_STEPS, *[_DEFLECTION] * len(delta))
        self._model.command(delta)
        moved = []
        for near in _neighbours(x, steps):
            self._model.place(near)
            moved.append(self._model.readings())
        xdot = self._at(x, delta)
        for near in _neighbours(delta, steps[len(x) :]):
            self._model.respond(near)
            moved.append(self._model.readings())
        velocities = np.tile(self._model.velocity() / FOOT, (len(moved), 1))
        for i in range(6):
            velocities[i, i // 2] += (1.0, -1.0)[i % 2]
        there = self._model.consistent(np.array(moved), velocities) * SI
        jacobian = (there[0::2] - there[1::2]).T / (2.0 * np.array(steps))
        a, b = jacobian[:, : len(STATES)].copy(), jacobian[:, len(STATES) :].copy()
        bias = xdot - (a * sample.x).sum(axis=1) - (b * sample.delta).sum(axis=1)
        return LinearTruth(sample.time, a, b, bias)

    def _at(self, x: Sequence[float], delta: Sequence[float]) -> Array:
        self._model.put(x, delta)
        return self._model.derivative()


def _neighbours(point: list[float], steps: Sequence[float]) -> Iterator[list[float]]:
    """Yield the point moved up and down in each of its coordinates."""
    for i, value in enumerate(point):
        for step in (steps[i], -steps[i]):
            yield [*point[:i], value + step, *point[i + 1 :]]
