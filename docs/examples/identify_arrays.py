"""Identify from arrays, without ROS: ``python identify_arrays.py``."""

from __future__ import annotations

import numpy as np

from msls_ros.estimation import Configuration, Identifier

A, B = np.array([[-2.0, 0.8], [-0.4, -0.9]]), np.array([[12.0, 1.5], [-0.6, -5.0]])
random = np.random.default_rng(0)
time = np.arange(0.0, 8.0, 0.02)  # [s]
delta = 0.02 * random.standard_normal((len(time), 2))  # measured deflections [rad]
x = np.zeros((len(time), 2))  # P, R [rad/s]
for k in range(len(time) - 1):
    x[k + 1] = x[k] + 0.02 * (A @ x[k] + B @ delta[k])
xdot = x @ A.T + delta @ B.T  # measured, or differentiated by the same window as x and delta

identifier = Identifier(Configuration(states=("P", "R"), effectors=("da", "dr"), known_gravity=False))
last = identifier.run(time, x, xdot, delta).estimates[-1]
for row, values, errors, reliable in zip(last.states, last.b, last.b_std, last.b_reliable, strict=True):
    cells = [f"{v:8.3f} ± {e:.3f}{'' if r else ' ?'}" for v, e, r in zip(values, errors, reliable, strict=True)]
    print(f"d{row}/dt: {'  '.join(cells)}")
