"""Isolation: the columns that changed are named, with what is left of them; no others are."""

from __future__ import annotations

import numpy as np
import pytest

from msls_ros.estimation.isolation import Suspect, invert, suspects

P = 9
Case = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def case(seed: int, changes: dict[int, float], noise: float = 0.02) -> Case:
    """Return covariance, estimates before and since, for columns changed to a share of what they were."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((P, P)) * 0.3 + np.eye(P)
    before_covariance = noise**2 * root @ root.T
    truth = rng.choice([-1.0, 1.0], P) * rng.uniform(0.5, 2.0, P)
    after = truth.copy()
    for column, share in changes.items():
        after[column] *= share
    before = truth + noise * root @ rng.standard_normal(P)
    since = after + noise * root @ rng.standard_normal(P)
    return 2.0 * before_covariance, before, np.sqrt(np.diagonal(before_covariance)), since


def named(parts: Case) -> list[Suspect]:
    covariance, before, std, since = parts
    limits = {"significance": 4.0, "explained": 0.7, "largest_error": 0.1}
    return suspects(covariance, before, std, since, range(P - 1), **limits)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5])
def test_the_column_that_changed_is_named_with_what_is_left_of_it(share: float) -> None:
    right, deviations = 0, []
    for seed in range(40):
        found = named(case(seed, {3: share, P - 1: 0.2}))
        if found and found[0].column == 3:
            right += 1
            deviations.append((found[0].effectiveness - share) / found[0].effectiveness_std)
    assert right >= 38
    assert 0.6 < float(np.std(deviations)) < 1.5


def test_two_columns_that_change_together_are_both_found() -> None:
    right = 0
    for seed in range(40):
        found = named(case(seed, {2: 0.5, 5: 0.4}))
        right += {s.column for s in found} == {2, 5}
    assert right >= 32


def test_nothing_is_named_when_nothing_changed() -> None:
    assert sum(bool(named(case(seed, {}))) for seed in range(200)) <= 2


def test_a_column_without_a_known_effect_before_is_not_named() -> None:
    covariance, before, std, since = case(1, {})
    before[4], since[4] = 0.0, 5.0
    assert all(s.column != 4 for s in named((covariance, before, std, since)))


def test_a_covariance_that_is_none_gives_no_suspect() -> None:
    covariance, before, std, since = case(1, {3: 0.0})
    assert named((-covariance, before, std, since)) == []
    covariance[0, 0] = np.inf
    assert named((covariance, before, std, since)) == []


def test_the_inverse_is_one() -> None:
    covariance, *_ = case(0, {})
    inverse = np.zeros((P, P))
    assert invert(covariance, inverse, np.zeros((2, P, P)))
    assert np.allclose(inverse @ covariance, np.eye(P), atol=1e-9)
