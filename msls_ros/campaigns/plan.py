"""What a campaign flies: scenarios, noises and settings of the identifier, all checked before anything flies."""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from msls_ros.campaigns.flight import SHORT, Cell, Task
from msls_ros.control import ControlError, ControlSettings
from msls_ros.control.settings import items
from msls_ros.estimation import Configuration, EstimationError
from msls_ros.estimation.configuration import as_mapping
from msls_ros.estimation.errors import nearest
from msls_ros.flights.scenario_law import LAW_COMPARED, LawChoice, changed_law
from msls_ros.flights.scenarios import OURS, Scenario, ScenarioError, find_scenario
from msls_ros.plant import NOISE_LEVELS

FULL = {short: name for name, short in SHORT.items()}
LAST_SEED = 2**31 - 1
Setting = tuple[tuple[str, Any], ...]


class PlanError(ValueError):
    """A campaign cannot be flown as asked for: one sentence, what was found and what was expected."""


def noise_list(text: str) -> tuple[str, ...]:
    """Read ``none,low``."""
    found = tuple(text.split(","))
    for noise in found:
        if noise not in NOISE_LEVELS:
            message = f"{noise!r} is no noise level; expected some of {','.join(NOISE_LEVELS)}"
            raise argparse.ArgumentTypeError(message)
    if len(set(found)) < len(found):
        message = f"{text!r} has a noise level twice; expected each once"
        raise argparse.ArgumentTypeError(message)
    return found


def comparison(text: str) -> tuple[str, tuple[str, ...]]:
    """Read ``lambda=0.8,0.9``: the full name of a parameter, and its values as they stand there."""
    name, equals, rest = text.partition("=")
    values = tuple(value.strip() for value in rest.split(","))
    if not equals or not name or "" in values:
        message = f"{text!r} is no comparison; expected NAME=VALUE,VALUE such as lambda=0.8,0.9,0.95"
        raise argparse.ArgumentTypeError(message)
    return FULL.get(name, name), values


def plan(
    names: Sequence[str],
    noises: Sequence[str] | None,
    comparisons: Sequence[tuple[str, tuple[str, ...]]],
    dither: bool,
) -> list[Cell]:
    """Return what is to be flown with each seed.

    Parameters
    ----------
    names
        Of shipped scenarios, or paths of .yaml files.
    noises
        Of the sensors; None: each scenario's own.
    comparisons
        Parameters of the identifier and their values; all combinations are flown.
    dither
        Inject noise.

    Raises
    ------
    PlanError
        For a thing twice, or a parameter that cannot be compared.
    ScenarioError
        For a scenario that does not exist, or a wrong file.
    EstimationError
        For a parameter that does not exist, or a value that it refuses.
    """
    scenarios = [find_scenario(name) for name in names]
    _refuse_twice([one.name for one in scenarios], "scenario")
    _refuse_twice([name for name, _ in comparisons], "--compare")
    cells = []
    for scenario in scenarios:
        for noise in noises or (scenario.noise,):
            base = scenario.configuration(noise, 0, dither)
            for one in _settings(base, scenario.law, comparisons):
                changes = {name: value for name, value in one if not _of_law(name)}
                known = as_mapping(base)
                same = bool(one) and all(known.get(name) == value for name, value in one)
                cells.append(Cell(_with_law(scenario, one), noise, one, base.replace(changes), same))
    return cells


def _of_law(name: str) -> bool:
    """Whether a comparison is one of the control law, not of the identifier."""
    return name in LAW_COMPARED or name.startswith("control.")


def _with_law(scenario: Scenario, setting: Setting) -> Scenario:
    """Return a scenario with what of a setting concerns the law.

    Raises
    ------
    PlanError
        For a law that cannot be flown, or a parameter that it refuses.
    """
    changes = {name: value for name, value in setting if _of_law(name)}
    if not changes:
        return scenario
    try:
        return replace(scenario, law=changed_law(scenario.law, changes))
    except (ScenarioError, ControlError) as error:
        message = f"--compare: {error}"
        raise PlanError(message) from error


def _settings(
    base: Configuration, law: LawChoice, comparisons: Sequence[tuple[str, tuple[str, ...]]]
) -> Iterator[Setting]:
    """Yield all combinations of the values, each of the type that its parameter has; first what is configured."""
    known = as_mapping(base)
    axes = []
    for name, texts in comparisons:
        if _of_law(name):
            _refuse_twice(list(texts), f"--compare {name}")
            axes.append([(name, value) for value in law_values(law, name, texts)])
            continue
        if name in OURS:
            message = f"--compare {name}: it cannot be compared, {OURS[name]} gives it"
            raise PlanError(message)
        if name not in known:
            near = nearest(name, (*FULL, *known, *(full.rpartition(".")[2] for full in known)))
            there = " There are" if near else "; there are"
            message = f"--compare: parameter '{name}' does not exist{near}{there} {', '.join((*FULL, *known))}"
            raise PlanError(message)
        if isinstance(known[name], tuple):
            message = f"--compare {name}: it is a list; expected a parameter of one number or word"
            raise PlanError(message)
        if name == FULL["lambda"] and base.estimator.time_constant > 0.0:
            message = "--compare lambda: estimator.time_constant gives it here; compare that one"
            raise PlanError(message)
        values = [_typed(text, known[name]) for text in texts]
        _refuse_twice([f"{value}" for value in values], f"--compare {name}")
        axes.append([(name, value) for value in values])
    combinations = list(itertools.product(*axes))
    configured = tuple((name, known[name]) for name, _ in comparisons if name in known)
    if len(configured) == len(comparisons) > 0 and configured not in combinations:
        yield ()
    yield from combinations


def law_values(law: LawChoice, name: str, texts: Sequence[str]) -> list[Any]:
    """Return values of what belongs to the law, each in the type that it has there."""
    if name in LAW_COMPARED:
        return [_typed(text, LAW_COMPARED[name]) for text in texts]
    known = {one: value for one, value, _ in items(ControlSettings())}
    short = name.removeprefix("control.")
    if short not in known or isinstance(known[short], tuple):
        message = f"--compare {name}: expected control. and a parameter of one number or word: {', '.join(known)}"
        raise PlanError(message)
    if law.law is None:
        message = f"--compare {name}: the scenario has no law; expected --compare law=... first"
        raise PlanError(message)
    return [_typed(text, known[short]) for text in texts]


def _typed(text: str, like: Any) -> Any:
    """Return the value in the type of the parameter's, or as it stands: then the configuration refuses it."""
    if isinstance(like, bool):
        return {"true": True, "false": False}.get(text.lower(), text)
    if isinstance(like, (int, float)):
        try:
            return type(like)(text)
        except ValueError:
            return text
    return text


def _refuse_twice(values: Sequence[str], what: str) -> None:
    for value in values:
        if values.count(value) > 1:
            message = f"{what}: '{value}' is there twice; expected each once"
            raise PlanError(message)


def tasks_of(cells: Sequence[Cell], first_seed: int, seeds: int) -> list[Task]:
    """Return the flights, in the order of the tables.

    Raises
    ------
    PlanError
        For seeds beyond the last.
    """
    if first_seed + seeds - 1 > LAST_SEED:
        message = f"--first-seed {first_seed} with --seeds {seeds}: expected no seed beyond {LAST_SEED}"
        raise PlanError(message)
    return [Task(cell, seed, cell.flight_key(seed)) for cell in cells for seed in range(first_seed, first_seed + seeds)]


def name_of(cells: Sequence[Cell]) -> str:
    """Return a name for the campaign's folder."""
    names = list(dict.fromkeys(cell.scenario.name for cell in cells))
    return names[0] if len(names) == 1 else f"{names[0]}_and_{len(names) - 1}_more"


def explain(error: Exception) -> str:
    """Return what is wrong, as one line of the command."""
    return f"--compare: {error}" if isinstance(error, EstimationError) else str(error)
