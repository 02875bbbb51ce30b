"""Noise of the sensors of surfaces and of vanes: it looks like no delay, like no lag and like no loss."""

from __future__ import annotations

import math

import numpy as np
import pytest

from msls_ros.estimation import Estimate, EventKind, Identifier, from_mapping

RATE, SUBSTEPS = 50, 8
STEP = 1.0 / (RATE * SUBSTEPS)
SERVO, DAMPING = 28.0, 0.7
DEGREE = math.pi / 180.0
SPEED = 57.0
GRAVITY = 9.81


def events(estimates: list[Estimate], kind: EventKind) -> list[str]:
    return [event.description for one in estimates for event in one.events if event.kind == kind]


def roll(seed: int, noise: float, seconds: float = 40.0) -> list[Estimate]:
    """Identify aileron and rudder of an aircraft that a law flies through turns, with dither and noisy surfaces.

    ``noise`` is that of the surfaces' sensors [rad]; nothing else has any.
    """
    random = np.random.default_rng(seed)
    a = np.array([[-8.0, 2.0], [-0.2, -0.9]])
    b = np.array([[27.0, 2.0], [-0.7, -6.0]])
    n = round(seconds * RATE)
    dither = 0.1 * DEGREE * random.choice([-1.0, 1.0], (n, 2))
    x, act, rate, bank = np.zeros(2), np.zeros(2), np.zeros(2), 0.0
    read, derivative, surface = np.zeros((n, 2)), np.zeros((n, 2)), np.zeros((n, 2))
    for k in range(n):
        wanted = 30.0 * DEGREE * (-1.0) ** (k // (10 * RATE)) if k > 2 * RATE else 0.0
        read[k], derivative[k], surface[k] = x, a @ x + b @ act, act
        law = np.array([0.1 * (1.5 * (wanted - bank) - x[0]), 0.3 * (x[1] - 0.1 * bank)])
        for _ in range(SUBSTEPS):
            rate += STEP * (SERVO * SERVO * (law + dither[k] - act) - 2.0 * DAMPING * SERVO * rate)
            act = act + STEP * rate
            x = x + STEP * (a @ x + b @ act)
            bank += STEP * x[0]
    named = {"states": ("P", "R"), "effectors": ("da", "dr"), "sample_rate": float(RATE), "known_gravity": False}
    delta = surface + noise * random.normal(size=surface.shape)
    return list(Identifier(from_mapping(named)).run(np.arange(n) / RATE, read, derivative, delta).estimates)


def pitch(seed: int, noise: float, seconds: float = 40.0) -> list[Estimate]:
    """Identify an elevator that a law moves slowly, for climbs; so many times ordinary noise in all sensors."""
    random = np.random.default_rng(seed)
    a = np.array([[-1.5, SPEED], [-0.15, -3.0]])
    b = np.array([-6.0, -14.0])
    n = round(seconds * RATE)
    x, act, rate, angle = np.zeros(2), 0.0, 0.0, 0.0
    read, derivative, surface = np.zeros((n, 2)), np.zeros((n, 2)), np.zeros(n)
    command = 0.0
    for k in range(n):
        goal = 6.0 * DEGREE if (k // (8 * RATE)) % 2 == 1 else 0.0
        command += (goal - command) / (0.6 * RATE)
        read[k] = x + noise * np.array([0.1, 0.1 * DEGREE]) * random.normal(size=2)
        derivative[k] = a @ x + b * act + noise * np.array([0.05, 0.5 * DEGREE]) * random.normal(size=2)
        surface[k] = act
        law = -0.3 * (1.2 * (command - angle - noise * 0.05 * DEGREE * random.normal()) - read[k, 1])
        for _ in range(SUBSTEPS):
            rate += STEP * (SERVO * SERVO * (law - act) - 2.0 * DAMPING * SERVO * rate)
            act += STEP * rate
            x = x + STEP * (a @ x + b * act)
            angle += STEP * x[1]
    named = {
        "states": ("w", "Q"),
        "effectors": ("de",),
        "sample_rate": float(RATE),
        "reference_speed": SPEED,
        "known_gravity": False,
    }
    delta = surface[:, None] + noise * 0.05 * DEGREE * random.normal(size=(n, 1))
    return list(Identifier(from_mapping(named)).run(np.arange(n) / RATE, read, derivative, delta).estimates)
