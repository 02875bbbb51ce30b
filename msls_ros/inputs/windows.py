"""Means of signals over windows, the white noise in samples, and two sides of an equation compared without it."""

from __future__ import annotations

import numpy as np

from msls_ros.estimation.kernel import Array

_NORMAL = 0.6745
"""Median size of a normal variable of standard deviation 1."""


def windowed(values: Array, width: int) -> Array:
    """Return the means (k - width, c) over windows of so many steps, by trapezoids."""
    middle = 0.5 * (values[1:] + values[:-1])
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(middle, axis=0)])
    return np.asarray((total[width:] - total[:-width]) / width)


def noise_of(values: Array) -> Array:
    """Return the variance (c,) of white noise in samples (k, c), of which most change as a smooth curve does.

    It is that of their third differences, 20 times as large; steps of an input are not many enough to count.
    """
    third = np.diff(values, 3, axis=0)
    return np.asarray(np.square(np.median(np.abs(third), axis=0) / _NORMAL) / 20.0)


def misfit(a: Array, b: Array) -> float:
    """Return 2 |a - b|^2 / (|a|^2 + |b|^2)."""
    both = float((a * a).sum() + (b * b).sum())
    return 2.0 * float(((a - b) ** 2).sum()) / both if both > 0.0 else 0.0


def third_differences(values: Array, apart: int) -> Array:
    """Return the third differences (k - 3 apart, c) of samples so many steps apart, over the root of 20.

    Of white noise they have the variance.
    """
    if not apart:
        return values[:0]
    near, far = values[2 * apart : -apart] - values[apart : -2 * apart], values[3 * apart :] - values[: -3 * apart]
    return np.asarray((far - 3.0 * near) / np.sqrt(20.0))


def mean_squares(values: Array) -> Array:
    """Return the mean squares (c,)."""
    return np.asarray(np.square(values).mean(axis=0)) if len(values) else np.zeros(values.shape[1])


def beyond_noise(a: Array, b: Array, noise: tuple[Array, Array]) -> tuple[float, float, float] | None:
    """Return the misfit of two sides (k, c) and the rms of each, without noise of these variances (c,) of a sample.

    Returns
    -------
    tuple or None
        None where noise makes up more than half of the two sides: they cannot be compared.
    """
    powers = [float(mean_squares(side).sum()) for side in (a, b)]
    shares = [min(float(n.sum()), power) for n, power in zip(noise, powers, strict=True)]
    sizes = [power - n for n, power in zip(shares, powers, strict=True)]
    both = sum(sizes)
    if both < sum(shares):
        return None
    left = max(float(mean_squares(a - b).sum()) - sum(shares), 0.0)
    return (2.0 * left / both if both > 0.0 else 0.0, float(np.sqrt(sizes[0])), float(np.sqrt(sizes[1])))
