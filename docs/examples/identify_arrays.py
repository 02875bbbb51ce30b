"""Identify from arrays, without ROS: ``python identify_arrays.py``."""

from __future__ import annotations

import numpy as np

from msls_ros.estimation import Configuration, Identifier
from msls_ros.inputs import differentiated

A, B = np.array([[-2.0, 0.8], [-0.4, -0.9]]), np.array([[12.0, 1.5], [-0.6, -5.0]])
step, one = 0.02, np.eye(2)
time = np.arange(0.0, 16.0, step)  # [s], float64
sweep = 2.0 * np.pi * (0.3 + 0.05 * time) * time
delta = 0.05 * np.stack([np.sin(sweep), np.sin(0.7 * sweep + 1.0)], axis=1)  # measured deflections [rad]
x = np.zeros((len(time), 2))  # P, R [rad/s]
for k in range(len(time) - 1):
    moved = (one + 0.5 * step * A) @ x[k] + 0.5 * step * B @ (delta[k] + delta[k + 1])
    x[k + 1] = np.linalg.solve(one - 0.5 * step * A, moved)
xdot = np.full_like(x, np.nan)  # a column that nobody measured is NaN; one that was measured is as measured

configuration = Configuration(states=("P", "R"), effectors=("da", "dr"), sample_rate=50.0, known_gravity=False)
made = differentiated(configuration, time, x, xdot, delta)  # all in the window in which the derivatives are made
identifier = Identifier(configuration, made.straddle)  # how long that window is; 0 where all xdot are measured
last = identifier.run(made.time, made.x, made.xdot, made.delta).estimates[-1]
for row, values, errors, reliable in zip(last.states, last.b, last.b_std, last.b_reliable, strict=True):
    cells = [f"{v:8.3f} ± {e:.3f}{'' if r else ' ?'}" for v, e, r in zip(values, errors, reliable, strict=True)]
    print(f"d{row}/dt: {'  '.join(cells)}")
