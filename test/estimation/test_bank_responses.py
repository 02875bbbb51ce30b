"""Commands to servos in place of deflections: lag and delay are found in flight, and measured deflections have none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from estimation.test_bank import SMALL, uniform
from estimation.test_bank_delay import EFFECTS, STEP

from benchmarks.linear_beds import configure, draw
from benchmarks.linear_beds import fly as fly_linear
from msls_ros.estimation import Estimate, EventKind, Identifier, from_mapping
from msls_ros.estimation.bank.regression import BankRegression
from msls_ros.estimation.bank.responses import turns_round
from msls_ros.estimation.bank.rows import begin_anew, reach_of, split_bank
from msls_ros.inputs import differentiated
from msls_ros.inputs.servo_lag import followed

DAMPING = np.array([6.0, 3.0, 2.0])
"""Of the rates [1/s]."""


def fly(
    lag: float,
    delay: float,
    *,
    noise: float = 0.05,
    seconds: float = 30.0,
    rate: int = 50,
    gusts: float = 0.0,
    measured: bool = False,
    behind: int = 0,
    late: float = 0.0,
) -> tuple[BankRegression, list[Estimate]]:
    """Identify from commands that a servo takes along ``lag`` and ``delay`` [s] late.

    ``noise`` is that of the outputs [rad/s^2]. With ``gusts`` nothing is commanded but what a law answers to them; with
    ``measured`` the deflections are recorded, with noise, and not the commands. ``behind``: the record of deflections
    is so many samples late, or ``late`` [s].
    """
    n = round(seconds / STEP)
    every = round(1.0 / (rate * STEP))
    inputs = 0.1 * np.repeat(uniform(n // 150 + 1, 2, 91), 150, axis=0)[:n]
    jitter = 0.01 * np.repeat(uniform(n // every + 1, 2, 92), every, axis=0)[:n]
    air, blown = np.zeros(3), gusts * uniform(n, 3, 93)
    command, x, xdot = np.zeros((n, 2)), np.zeros((n, 3)), np.zeros((n, 3))
    act = np.zeros((n + 1, 2))
    back = round(delay / STEP)
    for k in range(n):
        if k % every == 0:
            answer = np.array([-0.1 * x[k, 0], 0.1 * x[k, 1]])
            command[k] = answer if gusts > 0.0 else inputs[k] + jitter[k]
        else:
            command[k] = command[k - 1]
        air += STEP / 0.3 * (blown[k] - air)
        xdot[k] = EFFECTS @ act[k] - DAMPING * x[k] + air
        if k + 1 < n:
            x[k + 1] = x[k] + STEP * xdot[k]
        acts = command[max(k - back, 0)]
        act[k + 1] = act[k] + (STEP / lag if lag > STEP else 1.0) * (acts - act[k])
    taken = slice(0, n, every)
    identifier = Identifier(from_mapping({**SMALL, "sample_rate": float(rate)}))
    time, read = STEP * np.arange(n, dtype=np.float64)[taken], xdot[taken]
    recorded = act[np.maximum(np.arange(n) - round(late / STEP), 0)]
    delta = recorded[taken] + 0.001 * uniform(len(read), 2, 95) if measured else command[taken]
    if behind > 0:
        delta = np.concatenate([np.repeat(delta[:1], behind, axis=0), delta[:-behind]])
    estimates = identifier.run(time, x[taken], read + noise * uniform(len(read), 3, 94), delta).estimates
    engine = identifier._regression
    assert isinstance(engine, BankRegression)
    return engine, list(estimates)


@pytest.mark.parametrize("rate", [50, 100])
@pytest.mark.parametrize(("lag", "delay"), [(0.035, 0.02), (0.05, 0.02), (0.065, 0.03)])
def test_the_effects_of_servos_are_right_from_their_commands_alone(lag: float, delay: float, rate: int) -> None:
    engine, estimates = fly(lag, delay, rate=rate)
    last = estimates[-1]
    assert last.lag > 0.0
    assert engine.state.answered.all(), "its doubt of a quarter of each effect is none of whether there is one"
    assert last.lag + last.delay == pytest.approx(lag + delay + 0.5 / rate, abs=0.02), "held commands"
    main = EFFECTS != 0.0
    np.testing.assert_allclose(last.b[main], EFFECTS[main], rtol=0.2)
    assert (np.abs(last.b - EFFECTS) <= 1.96 * last.b_std).all()


@pytest.mark.parametrize("rate", [25, 50, 100])
def test_commands_a_tenth_of_a_second_late_are_no_losses(rate: int) -> None:
    """Of a delay without a lag a short one with it is what is found, and effects a third too large."""
    _, estimates = fly(0.0, 0.1, rate=rate)
    last = estimates[-1]
    assert 0.1 <= last.lag + last.delay <= 0.16
    assert (np.abs(last.b - EFFECTS) <= 1.96 * last.b_std).all()
    assert not [e for one in estimates for e in one.events if e.kind == EventKind.ISOLATED]


def test_deflections_of_before_that_stand_in_for_a_noisy_state_are_no_lag() -> None:
    """Q in noise: what the elevator made of it before says more of it, and Q by de was turned round (+80 of -62)."""
    for seed in (4232, 4261):
        random = np.random.default_rng(seed)
        one = replace(draw(random), lost=-1)
        last = Identifier(configure(one), 0).run(*fly_linear(one, random)).estimates[-1]
        assert last.lag < 0.1 and last.b[1, 0] < 0.0 and abs(last.b[1, 0] - one.b[1, 0]) < 1.96 * last.b_std[1, 0]


def test_effects_are_turned_round_by_the_sum_over_rows_that_count() -> None:
    engine, _ = fly(0.05, 0.02, seconds=10.0)
    s, x = engine.settings, engine.state
    x.response_effect[:] = 0.0
    x.response_fit[:, :, 1] = 1.0
    x.response_effect[0, 0, 0], x.response_effect[5, 0, 0] = 2.0, 1.0
    assert not turns_round(s, x, 5, 0)
    x.response_effect[5, 0, 0] = -1.0
    assert turns_round(s, x, 5, 0)
    x.response_fit[:, 0, 1] = 0.0
    assert not turns_round(s, x, 5, 0), "that row does not count"


def test_after_an_alarm_behind_an_actuator_nothing_is_learnt_while_what_acted_before_acts() -> None:
    engine, _ = fly(0.05, 0.02)
    s, x = engine.settings, engine.state
    assert x.response[0] > 0
    late = float(max(s.responses[x.response[0], 1], 0)) * s.late * s.period
    alarm = np.array([1, 0, 0], np.int64)
    split_bank(s, x, alarm)
    assert x.waiting[x.group[0]] - 1 == reach_of(s, x) >= (late + engine.lag) / s.period
    assert x.waiting[x.group[1]] == 0
    x.response[0] = 0
    x.delay[:, 0] = 0.0
    split_bank(s, x, alarm)
    assert x.waiting[x.group[0]] == 0, "deflections as they are recorded"
    x.delay[:, 0] = 0.6
    split_bank(s, x, alarm)
    assert x.waiting[x.group[0]] - 1 == 1, "what acted before acts for a part of the next sample"


@pytest.mark.parametrize("noise", [0.05, 0.3])
def test_a_servo_of_seven_radians_a_second_is_found_in_noise(noise: float) -> None:
    """In the larger noise effectors explain little of a quick output; what is white in it is its sensor's."""
    _, estimates = fly(0.14, 0.02, noise=noise, seconds=60.0)
    last = estimates[-1]
    assert last.lag == 0.14
    main = EFFECTS != 0.0
    np.testing.assert_allclose(last.b[main], EFFECTS[main], rtol=0.25)
    assert (np.abs(last.b - EFFECTS) <= 1.96 * last.b_std).all()


def test_before_it_is_decided_the_bars_say_so() -> None:
    """Without a lag in the regressor a third is missing, and least squares would be sure of it."""
    _, estimates = fly(0.05, 0.02)
    for estimate in estimates:
        assert (np.abs(estimate.b - EFFECTS) <= 1.96 * estimate.b_std)[estimate.b_reliable].all()


def test_a_delay_without_a_lag_is_told_from_one() -> None:
    engine, estimates = fly(0.0, 0.045)
    assert estimates[-1].lag == 0.0
    assert estimates[-1].delay == pytest.approx(0.045 + 0.01, abs=0.006), "commands are held, half a sample"
    assert engine.state.response[0] != 0
    assert (np.abs(estimates[-1].b - EFFECTS) <= 1.96 * estimates[-1].b_std).all()


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.5])
def test_deflections_that_are_measured_have_none(noise: float) -> None:
    engine, estimates = fly(0.05, 0.0, noise=noise, measured=True)
    assert engine.state.response[0] == 0
    assert estimates[-1].lag == 0.0
    assert estimates[-1].samples > 1400


def test_a_name_that_is_awaited_is_not_spoken_once_another_response_is_taken() -> None:
    """What was known before the alarm is of other effectors: half of their effect is no loss."""
    engine, _ = fly(0.05, 0.0, measured=True)
    s, x = engine.settings, engine.state
    x.pending[0] = 1
    x.theta_before[0] = x.mixed[0]
    x.theta_before[0, s.effectors_from + 1 :] *= 2.0
    x.square_before[0] = 1e-6
    assert min(engine.losses([0]).change) == pytest.approx(-0.5, abs=0.1)
    begin_anew(s, x, engine._work.phi)
    assert engine.losses([0]).change == [0.0] * len(s.gains)
    assert not np.isfinite(engine.losses([0]).error).any()


@pytest.mark.parametrize(("rate", "behind"), [(25, 1), (50, 1), (50, 2), (100, 2), (100, 4)])
def test_deflections_that_are_recorded_late_cost_nothing_but_their_delay(rate: int, behind: int) -> None:
    """Responses come before them: every edge of an input was an error that no estimate explains."""
    _, estimates = fly(0.05, 0.0, rate=rate, measured=True, behind=behind)
    last = estimates[-1]
    assert last.delay == pytest.approx(-behind / rate, abs=0.006)
    assert (np.abs(last.b - EFFECTS) <= 1.96 * last.b_std).all()
    main = EFFECTS != 0.0
    np.testing.assert_allclose(last.b[main], EFFECTS[main], rtol=0.1)
    found = next(e.time for e in estimates if e.delay < 0.0)
    assert found < 12.0
    assert not any(v.kind == EventKind.DETECTED for e in estimates for v in e.events if e.time > found)


def test_what_is_not_decided_widens_bars_by_what_it_would_change() -> None:
    """Records 2 ms late at 100 Hz: there is evidence for half a minute, never decisive, and it changes next to nothing.

    By the evidence alone bars were .3 and more of an effect, and a loss of half of it was not seen.
    """
    engine, estimates = fly(0.05, 0.0, rate=100, measured=True, late=0.002)
    main = EFFECTS != 0.0
    assert engine.state.response[0] == 0 and max(engine.state.response_evidence) > 5.0
    last = estimates[-1]
    assert (last.b_std[main] < 0.15 * np.abs(EFFECTS[main])).all() and last.b_reliable[main].all()
    assert (np.abs(last.b - EFFECTS) <= 1.96 * last.b_std).all()
    assert abs(last.delay + 0.002) < 1.96 * last.delay_std < 0.01, "nor is a delay of nothing known to a millisecond"


def test_what_a_law_answers_gusts_with_is_no_evidence() -> None:
    """It follows them, as a response to a lag would: a lag explains twice as much of them, and that is little."""
    engine, _ = fly(0.05, 0.0, gusts=30.0, measured=True)
    assert engine.state.response[0] == 0


def behind_a_servo(rate: int, seed: int, late: float | None = None) -> Estimate:
    """Of a roll axis whose servo of second order, 55 ms in all, is declared as a lag of that: commands through it.

    With ``late`` [s]: of the surface as it is, recorded so much early.
    """
    declared = late is None
    step, corner = 0.0025, 1.6 / 0.055
    random = np.random.default_rng(seed)
    n = round(60.0 / step)
    pulses = [(3.0 + 6.0 * k + random.uniform(0.0, 2.0), random.uniform(0.03, 0.08)) for k in range(9)]
    roll = angle = surface = speed = wanted = sent = 0.0
    rolls, commands, surfaces = np.zeros(n), np.zeros(n), np.zeros(n)
    for k in range(n):
        time = k * step
        if k % 4000 == 0:
            wanted = random.uniform(-0.6, 0.6)
        if k % 8 == 0:
            asked = np.clip(3.0 * (wanted - angle), -1.0, 1.0)
            doublet = sum(
                size * ((begin <= time < begin + 0.4) - (begin + 0.4 <= time < begin + 0.8)) for begin, size in pulses
            )
            sent = 0.11 * asked + 0.04 * (asked - roll) + doublet
        rolls[k], commands[k], surfaces[k] = roll, sent, surface
        speed += step * (corner * corner * (sent - surface) - 1.6 * corner * speed)
        before, surface = surface, surface + step * speed
        kept = np.exp(-17.0 * step)
        later = kept * roll + (1.0 - kept) / 17.0 * 180.0 * 0.5 * (before + surface)
        angle += 0.5 * step * (roll + later)
        roll = later
    apart = round(1.0 / (rate * step))
    if late is None:
        made = followed(np.rint(np.arange(n) * step * 1e9).astype(np.int64), commands, 0.055, 10**9)[::apart, None]
    else:
        made = np.append(surfaces[round(late / step) :], np.full(round(late / step), surface))[::apart, None]
    measured = rolls[::apart, None] + 0.004 * random.normal(size=(len(made), 1))
    names = {"states": ("P",), "effectors": ("da",), "reference_speed": 17.0, "known_gravity": False}
    configuration = from_mapping({**names, "sample_rate": float(rate)})
    window = differentiated(configuration, np.arange(len(made)) / rate, measured, None, made)
    return Identifier(configuration, window.straddle, servos=declared).run(*window[:4]).estimates[-1]


@pytest.mark.parametrize("rate", [25, 50])
def test_what_a_declared_servo_leaves_of_delay_says_that_it_may_be_another(rate: int) -> None:
    """Of 180 come 250 to 300 (1.4 to 1.6 of it), and 20 ms are found to be left: the bars were .04 to .06 of that."""
    for seed in range(3):
        last = behind_a_servo(rate, seed)
        assert 0.014 < last.delay < 0.026
        assert last.b[0, 0] > 1.2 * 180.0, "or this proves nothing"
        assert abs(last.b[0, 0] - 180.0) < 1.96 * last.b_std[0, 0] < 0.75 * last.b[0, 0]


@pytest.mark.parametrize("rate", [25, 50])
def test_what_a_record_leaves_of_delay_is_no_servo(rate: int) -> None:
    """The same aircraft with deflections that are recorded 15 ms early: right, and known to a tenth."""
    for seed in range(3):
        last = behind_a_servo(rate, seed, late=0.015)
        assert 0.010 < last.delay < 0.022
        assert abs(last.b[0, 0] - 180.0) < 1.96 * last.b_std[0, 0] < 0.2 * 180.0


def test_a_response_that_is_taken_is_an_event() -> None:
    _, estimates = fly(0.05, 0.0, measured=True, behind=2)
    found = next(e for e in estimates if e.delay < 0.0)
    told = [v for e in estimates for v in e.events if v.kind == EventKind.RESET]
    assert [v.time for v in told] == [found.time]
    assert "begins anew at" in told[0].description and "deflections act after -40 ms" in told[0].description
