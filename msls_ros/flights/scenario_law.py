"""What a scenario says of the control law: ``law``, ``control``, ``prior``, ``latency`` and ``random_failures``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from msls_ros.control import LAWS, ControlError, ControlSettings
from msls_ros.flights.random_failures import KINDS, RandomFailures
from msls_ros.flights.scenario_yaml import Section, shown
from msls_ros.flights.steering import LawPlan
from msls_ros.plant import Airframe

LAW_KEYS = ("law", "control", "prior", "latency", "random_failures")
FIXED = "fixed"
LONGEST_LATENCY = 20
"""[samples]"""


@dataclass(frozen=True)
class LawChoice:
    """Which law flies, and how late its commands come."""

    law: str | None = None
    """A name of `LAWS`; None: the pilot's fixed law, and tracking is not judged."""
    control: Mapping[str, Any] = field(default_factory=dict)
    """What differs from the defaults of `ControlSettings`."""
    prior: bool = True
    """Whether the truth at trim is known at the start."""
    latency: int = 0
    """[samples]"""

    @property
    def plan(self) -> LawPlan | None:
        """For the closed loop; None: the fixed law flies as it is."""
        if self.law in (None, FIXED):
            return None
        own = {"stack": self.prior, **self.control, "law": self.law}  # who knows nothing has no other law either
        return LawPlan(ControlSettings().changed(own), self.prior)


LAW_COMPARED: Mapping[str, Any] = {"law": "auto", "prior": "truth", "latency": 0}
"""What of a law campaigns can compare beside its parameters, with an example of its value."""


def changed_law(choice: LawChoice, changes: Mapping[str, Any]) -> LawChoice:
    """Return a choice with changes by key; a parameter's key begins with ``control.``.

    Raises
    ------
    ScenarioError, ControlError
        For a value that is refused.
    """
    control = {**choice.control, **{k.removeprefix("control."): v for k, v in changes.items() if "." in k}}
    top = {"law": choice.law or FIXED, "prior": "truth" if choice.prior else "none", "latency": choice.latency}
    top |= {key: value for key, value in changes.items() if "." not in key}
    return read_law(Section(Path("--compare"), "", {**top, "control": control}))


def read_law(top: Section) -> LawChoice:
    """Return what a scenario says of the law."""
    law = top.word("law", LAWS) if "law" in top.values else None
    section = top.section("control", default={})
    if section.values and law is None:
        top.refuse("control", "is there without law; expected a law that it is for")
    try:
        ControlSettings().changed(section.values)
    except ControlError as error:
        top.wrap("control", error)
    if "law" in section.values:
        section.refuse("law", "stands in the section; expected the key law of the scenario itself")
    prior = top.word("prior", ("truth", "none"), "truth") == "truth"
    return LawChoice(law, dict(section.values), prior, top.whole("latency", 0, LONGEST_LATENCY, "samples", 0))


def read_random_failures(top: Section, duration: float, airframe: Airframe) -> RandomFailures | None:
    """Return what a scenario says of random failures; None: nothing."""
    if "random_failures" not in top.values:
        return None
    if top.values.get("faults"):
        top.refuse("random_failures", "is there beside faults; expected one of them")
    section = top.section("random_failures", ("surfaces", "kinds", "seed", "time"))
    most, kinds = len(airframe.surfaces), section.values.get("kinds", list(KINDS[:3]))
    counts = section.values.get("surfaces", [1, min(3, most)])
    whole = isinstance(counts, list) and len(counts) == 2 and all(type(one) is int for one in counts)
    if not whole or not 1 <= counts[0] <= counts[1] <= most:
        section.refuse("surfaces", f"is {shown(counts)}; expected fewest and most, from 1 to {most}: [1, 3]")
    if not isinstance(kinds, list) or not kinds or any(kind not in KINDS for kind in kinds):
        section.refuse("kinds", f"is {shown(kinds)}; expected a list of some of {', '.join(KINDS)}")
    seed, time = section.whole("seed", 0, 2**31 - 1, "", 0), section.number("time", 0.0, duration, "s", 4.0)
    return RandomFailures((counts[0], counts[1]), tuple(kinds), seed, time)
