"""Whether the right effector or surface was named, and the share that is left of its effect right within its error."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from msls_ros.estimation.estimate import EventKind, FaultEvent
from msls_ros.flights.closed_loop import FlightLog
from msls_ros.flights.judging import TICK
from msls_ros.flights.scenarios import Scenario
from msls_ros.plant import STATES

_CHANGED = 0.1
"""Share of its effect that an effector must have lost, or gained, to be named rightly."""


def judge_names(scenario: Scenario, log: FlightLog) -> dict[str, Any]:
    """Return how many faults were named rightly, wrongly and not at all, and the z-scores of the shares left.

    Parameters
    ----------
    scenario
        What was flown.
    log
        What the flight left behind.
    """
    effectors = list(scenario.airframe.effectors)
    names = {*effectors, *scenario.airframe.surface_names}
    named = [e for e in log.events if e.kind == EventKind.ISOLATED and e.suspected_effector in names]
    found: dict[str, Any] = {"rightly": 0, "wrongly": 0, "not": 0, "z": []}
    used: set[int] = set()
    spans = scenario.fault_spans
    for (start, end), following in zip(spans, (*(start for start, _ in spans[1:]), math.inf), strict=True):
        own = [k for k, e in enumerate(named) if start + TICK < e.time <= following + TICK and k not in used]
        used |= set(own)
        shares = {
            k: _share(log, named[k], effectors, start, end)
            if named[k].suspected_effector in effectors
            else _surface_share(scenario, named[k])
            for k in own
        }
        right = [k for k, share in shares.items() if share is not None and abs(share - 1.0) > _CHANGED]
        found["rightly" if right else "wrongly" if own else "not"] += 1
        for k in right:
            error = named[k].effectiveness_std
            if error > 0.0 and np.isfinite(error):
                found["z"].append(round((named[k].effectiveness - float(shares[k] or 0.0)) / error, 4))
    found["wrongly"] += sum(k not in used for k in range(len(named)))
    return found


def _surface_share(scenario: Scenario, event: FaultEvent) -> float:
    """Return what is truly left of the named surface's effect when it is named."""
    struck = [fault for fault in scenario.faults if event.suspected_effector in fault.surfaces]
    return next((fault.left(event.time) for fault in reversed(struck) if fault.time <= event.time), 1.0)


def _share(log: FlightLog, event: Any, effectors: list[str], start: float, end: float) -> float | None:
    """Return what is truly left of the named effector's effect on the event's equations; None: it had none."""
    steps = sorted(log.truths)
    before = next((k for k in reversed(steps) if log.time[k] <= start + TICK), steps[0])
    after = next((k for k in steps if log.time[k] > end + TICK), steps[-1])
    column = effectors.index(event.suspected_effector)
    rows = [STATES.index(name) for name in event.equations if name in STATES]
    old, new = (np.asarray(log.truths[k].b)[rows, column] for k in (before, after))
    power = float(old @ old)
    return float(old @ new) / power if power > 0.0 else None
