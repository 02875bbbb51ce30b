"""Identifier and plant that keep a log of what they did, for `fault_network`; run as processes of their own."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from msls_ros.estimation import Identifier
from msls_ros.inputs import PairedSample
from msls_ros.nodes.identifier import IdentifierNode
from msls_ros.nodes.plant import PlantNode
from msls_ros.nodes.running import run_node


class WatchedIdentifier(IdentifierNode):
    """Keeps its samples; at the end an identifier of its own takes them, and must say the same."""

    def __init__(self, **options: Any) -> None:
        self._samples: list[PairedSample] = []
        super().__init__(**options)

    def _use(self, sample: PairedSample, newest: bool = True) -> None:
        self._samples.append(sample)
        super()._use(sample, newest)

    def report(self) -> dict[str, Any]:
        """Say how many samples came, and whether the estimates are those of them."""
        assert self._identifier is not None
        again, mine = Identifier(self._identifier.configuration, gated=True), self.estimate
        found = None
        for sample in self._samples:
            if sample.restarted:
                again.reset()
            found = again.update(sample.time, sample.x, sample.xdot, sample.delta)
        same = mine is not None and found is not None
        if mine is not None and found is not None:
            same = all((getattr(mine, n) == getattr(found, n)).all() for n in ("a", "b", "bias", "a_std", "b_std"))
        return {"samples": len(self._samples), "same_bits": bool(same), "old": self._answers.old}


class WatchedPlant(PlantNode):
    """Keeps, for every step, when it was, what dither was applied and how old that was."""

    def __init__(self, **options: Any) -> None:
        self._log: list[tuple[float, float, float]] = []
        self._largest = 0.0
        super().__init__(**options)

    def _on_answer(self, kind: str, message: Any) -> None:
        super()._on_answer(kind, message)
        if kind == "dither" and self._answers["dither"] is not None:
            Path(sys.argv[2]).with_suffix(".flying").touch()

    def _fly(self, command: Any) -> None:
        now = self._steady.now().nanoseconds * 1e-9
        base = self._answers["command"]
        dither = command - (self._aircraft.trim.delta if base is None else base)
        size = float(np.abs(dither).max())
        held = (now - self._arrived["dither"] * 1e-9) if size > 0.0 else 0.0
        self._log.append((now, size, held))
        self._largest = max(self._largest, float(np.abs(self._aircraft.sample().x).max()))
        super()._fly(command)

    def report(self) -> dict[str, Any]:
        """Give the log."""
        return {"log": self._log, "largest_state": self._largest, "finite": bool(np.isfinite(self._largest))}


def main() -> int:
    """Run one of the two; write its report into the file that is the second argument."""
    kind = {"identifier": WatchedIdentifier, "plant": WatchedPlant}[sys.argv[1]]
    made: list[Any] = []

    def make() -> Any:
        made.append(kind())
        return made[0]

    code = run_node(make, sys.argv[3:])
    if made:
        Path(sys.argv[2]).write_text(json.dumps(made[0].report()))
    return code


if __name__ == "__main__":
    sys.exit(main())
