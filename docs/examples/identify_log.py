"""Identify from a recording or from arrays, by the map and the checks of the flight: ``python identify_log.py LOG``."""

from __future__ import annotations

import sys

import numpy as np

from msls_ros.offline.identification import identify_log, identify_messages, rows

result = identify_log(sys.argv[1])  # or identify_log("flight.mcap", "my_stack.yaml")
row, column = result.states.index("P"), result.effectors.index("ddt")
best = np.argmin(result.b_std[:, row, column])  # of the models b (k, n, m), with time (k,)
print(f"dP/dt by ddt: {result.b[best, row, column]:.3f} ± {result.b_std[best, row, column]:.3f} 1/s^2")
print([(round(event.time, 2), event.kind.name, event.suspected_effector) for event in result.events])

# Arrays of your own log, here made up: dP/dt = -2 P + 12 da. Derivatives that are not mapped are made.
time = np.arange(1.0, 9.0, 0.01)  # [s]
da = 0.05 * np.sin(2.0 * np.pi * (0.3 + 0.1 * time) * time)  # [rad]
p = np.zeros(len(time))  # [rad/s]
for k in range(len(time) - 1):
    p[k + 1] = p[k] + 0.01 * (-2.0 * p[k] + 12.0 * da[k])
parameters = {
    "states": ["P"],
    "effectors": ["da"],
    "sample_rate": 100.0,
    "inputs": {  # as below ros__parameters of a parameter file; of the types any name will do
        "topics": {"log": "/log my/msg/Log"},
        "clock": "log",
        "states": {"P": "log gyro_x"},
        "effectors": {"da": "log aileron scale=0.01745329"},
    },
}
own = identify_messages(rows("/log", time, gyro_x=p, aileron=np.degrees(da)), parameters)
print(f"dP/dt by da: {own.b[-1, 0, 0]:.2f} ± {own.b_std[-1, 0, 0]:.2f} 1/s^2")
