"""Compile every kernel before the first sample comes."""

from __future__ import annotations

import numpy as np

from msls_ros.control.aircraft import ControlledAircraft, Prior
from msls_ros.control.controller import Controller
from msls_ros.control.settings import ControlSettings
from msls_ros.control.signals import ModelEstimate, PilotCommand


def warm_up(surfaces: int = 3) -> None:
    """Answer some samples of a made-up aircraft by each law."""
    s = surfaces
    b = np.zeros((9, s))
    for k in range(s):
        b[3 + k % 3, k] = 1.0
    a = np.zeros((9, 9))
    a[2, 4], a[1, 5] = 50.0, -50.0
    names = tuple(f"surface_{k}" for k in range(s))
    ones = (1.0,) * s
    made = ControlledAircraft(
        *(names, names, np.eye(s), tuple(-one for one in ones), ones, ones, ones), np.zeros(s), 0.0, Prior(a, b)
    )
    x = np.array([50.0, *[0.0] * 8])
    estimate = ModelEstimate(0.0, a, b, np.ones((9, 9)), np.ones((9, s)), alarm=True)
    for law in ("indi", "lq"):
        controller = Controller(made, ControlSettings(law=law))
        for k in range(3):
            controller.update(0.02 * k, x, np.zeros(9), np.zeros(s), PilotCommand(0.1, 0.0), estimate)
