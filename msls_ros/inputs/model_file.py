"""A model on disk: what an identifier has learnt, to look at and to start from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from msls_ros.estimation import EstimationError, Identifier
from msls_ros.estimation.estimate import Estimate

Array = np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True)
class SavedModel:
    """``xdot = a x + b delta + bias`` and how well it was known; n states, m effectors, p regressors."""

    states: tuple[str, ...]
    effectors: tuple[str, ...]
    regressors: tuple[str, ...]
    a: Array
    """(n, n)"""
    b: Array
    """(n, m)"""
    bias: Array
    """(n,)"""
    covariance: Array
    """(p, p) of the estimates over the residual variance; see `Identifier.warm_start`."""
    x: Array
    """(n,) states at which what is known from physics stands in ``a`` and ``bias``."""
    delta: Array
    """(m,) deflections there."""
    a_std: Array
    b_std: Array
    """(n, n) and (n, m) standard errors."""


def write_model(path: Path, identifier: Identifier, estimate: Estimate, x: Array, delta: Array, stamp: int) -> None:
    """Write what an identifier has learnt as YAML.

    Parameters
    ----------
    path
        Of the file; one that exists is replaced.
    identifier
        Its covariance and configuration are kept.
    estimate
        Its last.
    x, delta
        (n,) states and (m,) deflections of the last sample.
    stamp
        Of the last sample [ns].

    Raises
    ------
    EstimationError
        If the file cannot be written.
    """
    content = {
        "stamp": stamp,
        "samples": estimate.samples,
        "states": list(estimate.states),
        "effectors": list(estimate.effectors),
        "regressors": list(estimate.regressors),
        **{name: getattr(estimate, name).tolist() for name in ("a", "b", "bias", "a_std", "b_std")},
        "x": np.asarray(x, np.float64).tolist(),
        "delta": np.asarray(delta, np.float64).tolist(),
        "covariance": identifier.covariance.tolist(),
        "configuration": {k: list(v) if isinstance(v, tuple) else v for k, v in identifier.parameters.items()},
    }
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        fresh = path.with_name(f"{path.name}.new")
        fresh.write_text(yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=120), encoding="utf-8")
        fresh.replace(path)
    except OSError as error:
        message = f"the model cannot be written to '{path}': {error.strerror}"
        raise EstimationError(message) from error


def read_model(path: Path) -> SavedModel:
    """Read what `write_model` has written.

    Raises
    ------
    EstimationError
        For a file that is missing or wrong; the sentence names it.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        states, effectors, regressors = (tuple(map(str, content[k])) for k in ("states", "effectors", "regressors"))
        a, b, bias, covariance = (np.array(content[k], dtype=np.float64) for k in ("a", "b", "bias", "covariance"))
        a_std, b_std = (np.array(content[k], dtype=np.float64) for k in ("a_std", "b_std"))
        x = np.array(content["x"], dtype=np.float64) if "x" in content else None
        delta = np.array(content.get("delta", [0.0] * len(effectors)), dtype=np.float64)
    except OSError as error:
        message = f"the model '{path}' cannot be read: {error.strerror}"
        raise EstimationError(message) from error
    except (yaml.YAMLError, UnicodeDecodeError, KeyError, TypeError, ValueError) as error:
        message = f"'{path}' is not a model that ~/save_model has written: {' '.join(str(error).split())}"
        raise EstimationError(message) from error
    if x is None:
        message = (
            f"the model '{path}' is of an earlier version: it has no x, the states that it holds for; save it anew"
        )
        raise EstimationError(message)
    return SavedModel(states, effectors, regressors, a, b, bias, covariance, x, delta, a_std, b_std)


def start_if_there(identifier: Identifier, path: Path | None) -> list[str]:
    """Start an identifier of a recorded flight from the model that the flight began with.

    Returns
    -------
    list
        One sentence where the file is not there any more, and the identifier begins with nothing; otherwise none.

    Raises
    ------
    EstimationError
        As `start_from`, of a file that is there.
    """
    if path is None:
        return []
    if not path.is_file():
        cold = "begins with nothing learnt, not with the model of the flight"
        return [f"warm_start: the model '{path}' is not there: the identifier {cold}"]
    start_from(identifier, path)
    return []


def start_from(identifier: Identifier, path: Path) -> None:
    """Start an identifier from a model on disk.

    Raises
    ------
    EstimationError
        As `read_model`; also for other names than the identifier has.
    """
    model, c = read_model(path), identifier.configuration
    if (model.states, model.effectors, model.regressors) != (c.states, c.effectors, c.regressors):
        message = f"the model '{path}' has states {list(model.states)}, effectors {list(model.effectors)}; expected "
        raise EstimationError(message + f"{list(c.states)}, {list(c.effectors)}")
    errors = model.a_std, model.b_std
    identifier.warm_start(model.a, model.b, model.bias, model.covariance, model.x, model.delta, errors)
