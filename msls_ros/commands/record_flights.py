"""Record the flights in ``bags/`` again, with what they must give beside them.

``python -m msls_ros.commands.record_flights [FOLDER]`` flies each over DDS with its profile as it is now. To be done
after a change of the defaults, of the plant or of a message; the tests then hold to the new numbers.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rclpy.logging import LoggingSeverity, set_logger_level

from msls_ros.bags import BagError
from msls_ros.commands.progress import Progress
from msls_ros.estimation import EstimationError
from msls_ros.flights.scenarios import ScenarioError, find_scenario
from msls_ros.nodes.flight import FlightError, fly
from msls_ros.nodes.parameters import NodeError
from msls_ros.offline.replay import load
from msls_ros.plant import PlantError

FLIGHTS: Mapping[str, str] = {
    "intact_doublet": "roll_doublet",
    "tail_fault": "roll_doublet_tail_fault",
    "cruise_fault": "cruise_tail_fault",
}
"""Name of the bag, and the scenario that is flown."""
NOISE, SEED = "low", 0
FOLDER = Path(__file__).resolve().parents[2] / "bags"


def main(argv: Sequence[str] | None = None) -> int:
    """Record all flights; return the exit code."""
    parser = argparse.ArgumentParser(prog="record_flights", description="Record the flights in bags/ again.")
    parser.add_argument("folder", nargs="?", type=Path, default=FOLDER, help="where to (default: bags/)")
    folder = parser.parse_args(argv).folder
    set_logger_level("rcl", LoggingSeverity.ERROR)
    try:
        for name in FLIGHTS:
            record(name, folder)
    except (BagError, EstimationError, FlightError, NodeError, PlantError, ScenarioError, OSError) as error:
        print(f"record_flights: {error}", file=sys.stderr)
        return 2
    return 0


def record(name: str, folder: Path) -> None:
    """Fly one, into the bag ``folder/name``, and write what it gave to ``folder/name.json``."""
    scenario = find_scenario(FLIGHTS[name])
    bag = folder / name
    with Progress(f"flying {name}", scenario.duration, "s") as progress:
        fly(
            scenario,
            scenario.configuration(NOISE, SEED, dither=True),
            bag,
            noise=NOISE,
            seed=SEED,
            overwrite=True,
            progress=progress.show,
        )
    (folder / f"{name}.json").write_text(json.dumps(results(bag), indent=1) + "\n", encoding="utf-8")


def results(bag: Path) -> dict[str, Any]:
    """Return what the identifier's topics in a bag say: events, the last model, the last dither.

    Raises
    ------
    BagError
        If the bag cannot be read, or does not hold them.
    """
    flight = load(bag)
    if not flight.topic("model") or not flight.topic("dither"):
        message = f"{bag}: no topic model or dither; expected the bag of a flight or of a replay"
        raise BagError(message)
    stamp, model = flight.topic("model")[-1]
    dither = flight.topic("dither")[-1][1]
    return {
        "models": len(flight.topic("model")),
        "dithers": len(flight.topic("dither")),
        "events": [
            {
                "stamp_ns": at,
                "kind": event.kind,
                "equations": list(event.equations),
                "suspected_effector": event.suspected_effector,
                "description": event.description,
            }
            for at, event in flight.topic("fault")
        ],
        "last_model": {
            "stamp_ns": stamp,
            "samples": model.samples,
            "states": list(model.states),
            "effectors": list(model.effectors),
            "a": model.a.tolist(),
            "b": model.b.tolist(),
        },
        "last_dither": {"level": dither.level, "reason": dither.reason, "delta": dither.delta.tolist()},
    }


if __name__ == "__main__":
    sys.exit(main())
