"""How the dither begins: what nobody knows of is seen at the station, what is known is sent at once."""

from __future__ import annotations

import math

import numpy as np
import pytest
from estimation.dither_bench import M, accelerations, aircraft, at, drive, known, law

from msls_ros.estimation.dither.onset import BEGIN, DURATION
from msls_ros.estimation.kernel import Array
from msls_ros.estimation.kinematics import GRAVITY

STEP, SAMPLES = 0.02, 100


def fly(b: Array, seed: int, measured: bool = True, noise: float = 0.0) -> tuple[Array, Array]:
    """Return what is felt over the limit and the wanted rms (n,), of an aircraft B (6, M) of which nothing is known."""
    dither, c = law(seed=seed)
    nothing = known(1, np.zeros_like(b), math.inf, excitation=0.0)
    pole, surface, command = math.exp(-20.0 * STEP), np.zeros(M), np.zeros(M)
    random = np.random.default_rng(seed)
    shares, rms = np.zeros((SAMPLES, M)), np.zeros(SAMPLES)
    for k in range(SAMPLES):
        shares[k] = surface = pole * surface + (1.0 - pole) * command
        output = b @ surface + noise * random.standard_normal(6)
        one = nothing._replace(output=output[None, :, None]) if measured else nothing
        block = dither.commands(np.array([k * STEP]), one, surface[None])
        command, rms[k] = block.delta[0], block.rms[0]
    return np.linalg.norm(accelerations(b, shares, c), axis=1) / (c.dither.limit_nominal * GRAVITY), rms


def worst_second(shares: Array) -> float:
    """Return the largest rms over a second."""
    width = round(1.0 / STEP)
    return math.sqrt(float(np.convolve(np.square(shares), np.full(width, 1.0 / width), "valid").max()))


def test_a_strong_effector_of_which_nothing_is_known_is_not_felt_as_twice_the_limit() -> None:
    b = np.zeros((6, M))
    b[2, 0], b[4, 0], b[1, 1] = -40.0, -60.0, 3.0
    seen = [worst_second(fly(b, seed)[0]) for seed in range(8)]
    blind = [worst_second(fly(b, seed, measured=False)[0]) for seed in range(8)]
    assert np.mean(blind) > 2.0
    assert np.mean(seen) < 1.1
    assert max(seen) < 1.0


def test_noise_alone_does_not_hold_the_dither_back() -> None:
    b = 0.02 * aircraft()
    rms = np.array([fly(b, seed, noise=0.05)[1] for seed in range(8)])
    assert rms[:, 50:].mean() > 0.7 * rms[:, 50:].max()


def test_what_is_known_from_the_first_is_sent_at_once() -> None:
    block = drive(law()[0], known(SAMPLES, aircraft(), 0.01))
    assert block.rms[0] == pytest.approx(block.rms[-1])


def test_without_an_output_it_begins_small_and_is_whole_in_the_end() -> None:
    samples = round(DURATION / STEP) + 5
    block = drive(law()[0], known(samples, np.zeros((6, M)), math.inf, excitation=0.0))
    assert block.rms[0] == pytest.approx(BEGIN * block.rms[-1])


def test_it_is_the_same_sample_by_sample_and_in_one_block() -> None:
    n = 60
    output = np.random.default_rng(1).standard_normal((n, 6, 1))
    knowledge = known(n, np.zeros((6, M)), math.inf, excitation=0.0)._replace(output=output)
    whole = drive(law()[0], knowledge)
    dither, _ = law()
    for k in range(n):
        block = dither.commands(np.array([k * STEP]), at(knowledge, k), np.zeros((1, M)))
        assert (block.delta[0] == whole.delta[k]).all()
