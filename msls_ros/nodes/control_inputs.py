"""What a control law answers: messages of one stamp put together, checked and in order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros import messages
from msls_ros.control import ModelEstimate, PilotCommand
from msls_ros.control.aircraft import STATES
from msls_ros.inputs import NamedVector, Refused

Array = NDArray[np.float64]
KEPT = 64
"""Stamps that are kept at most."""
PARTS = ("state", "effectors", "pilot_command", "model", "dither")
"""Of a complete set."""
MODEL_FIELDS = ("a", "b", "a_std", "b_std")


@dataclass(frozen=True)
class Collected:
    """What came with one stamp [ns]; None: it did not, or has not yet."""

    stamp: int
    x: Array
    xdot: Array | None
    delta: Array
    command: PilotCommand | None
    model: Any
    """The message as it came."""
    dither: Array | None


class ControlInputs:
    """Collect messages by stamp.

    Parameters
    ----------
    effectors
        Names, in the order of the law.
    wait_for
        The parts of `PARTS` that a set must have.
    """

    def __init__(self, effectors: Sequence[str], wait_for: Sequence[str]) -> None:
        """Hold nothing yet; see the class."""
        self._effectors = tuple(effectors)
        self._wait_for = tuple(wait_for)
        self._states = NamedVector("state", STATES)
        self._vectors = {kind: NamedVector(kind, effectors) for kind in ("effectors", "pilot_command", "dither")}
        self._orders: dict[tuple[str, ...], NDArray[np.intp]] = {}
        self._parts: dict[int, dict[str, Any]] = {}
        self._answered = -1

    def clear(self) -> None:
        """Forget everything."""
        self._parts.clear()
        self._answered = -1

    def add(self, kind: str, message: Any) -> Collected | None:
        """Take a message; return the set that it completes.

        Raises
        ------
        Refused
            For a message that cannot be used.
        """
        stamp = messages.stamp_of(message)
        value = getattr(self, f"_read_{kind}")(message)
        if stamp <= self._answered:
            if self._answered - stamp < 1_000_000_000:
                if kind in self._wait_for:
                    text = f"{kind}: the sample at {stamp * 1e-9:.3f} s is answered; expected a later one"
                    raise Refused("stamp_back", text)
                return None
            self.clear()
        parts = self._parts.setdefault(stamp, {})
        parts[kind] = value
        if len(self._parts) > KEPT:
            del self._parts[min(self._parts)]
        if any(part not in parts for part in self._wait_for):
            return None
        self._answered = stamp
        self._parts = {one: held for one, held in self._parts.items() if one > stamp}
        x, xdot = parts["state"]
        rest = (parts.get(part) for part in PARTS[2:])
        return Collected(stamp, x, xdot, parts["effectors"], *rest)

    def _read_state(self, message: Any) -> tuple[Array, Array | None]:
        if len(message.xdot) == 0:
            return self._states.arrange(message.states, x=message.x)[0], None
        x, xdot = self._states.arrange_fields(message.states, {"x": message.x, "xdot": message.xdot})
        return x, xdot

    def _read_effectors(self, message: Any) -> Array:
        return self._vectors["effectors"].arrange(message.effectors, delta=message.delta)[0]

    def _read_dither(self, message: Any) -> Array:
        return self._vectors["dither"].arrange(message.effectors, delta=message.delta)[0]

    def _read_model(self, message: Any) -> Any:
        return message

    def _read_pilot_command(self, message: Any) -> PilotCommand:
        stack = None
        if len(message.delta):
            (stack,) = self._vectors["pilot_command"].arrange(message.effectors, delta=message.delta)
        command = PilotCommand(message.roll_rate, message.alpha, message.pitch_rate, message.beta, stack)
        if not command.usable:
            text = f"pilot_command: roll rate {message.roll_rate}, alpha {message.alpha}; expected finite numbers"
            raise Refused("not_finite", text)
        return command

    def model_of(self, message: Any, alarm: bool) -> ModelEstimate:
        """Return a model in the order of the law.

        Raises
        ------
        Refused
            For names that are missing, or lists of the wrong length.
        """
        rows = self._order(tuple(message.states), STATES)
        columns = self._order(tuple(message.effectors), self._effectors)
        n, m = len(message.states), len(message.effectors)
        arrays: dict[str, Array] = {}
        for name in MODEL_FIELDS:
            values, width = np.asarray(getattr(message, name), np.float64), n if name.startswith("a") else m
            if values.size != n * width:
                text = f"model: {name} has {values.size} values; expected {n * width}"
                raise Refused("length", text)
            arrays[name] = values.reshape(n, width)[np.ix_(rows, rows if name.startswith("a") else columns)]
        return ModelEstimate(messages.stamp_of(message) * 1e-9, **arrays, alarm=alarm)

    def _order(self, names: tuple[str, ...], wanted: Sequence[str]) -> NDArray[np.intp]:
        key = (*names, "|", *wanted)
        if key not in self._orders:
            missing = [name for name in wanted if name not in names]
            if missing:
                text = f"model: no '{missing[0]}' among the names {list(names)}; expected {list(wanted)}"
                raise Refused("names", text)
            self._orders[key] = np.array([names.index(name) for name in wanted], dtype=np.intp)
        return self._orders[key]


NO_COMMAND = PilotCommand(math.nan)
"""What a law is told when nobody asks for anything."""
