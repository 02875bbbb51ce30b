"""Paths into messages: ``twist.twist.linear.x``, ``position[name=elevator]``, ``channels[1]``.

Only attributes and items are read, so a path serves any message object: those of rclpy and those decoded from a bag.

=====================  =====================================================================================
``a.b``                attribute b of attribute a
``a[2]``               element 2 of the sequence a, from 0
``a[name=elevator]``   element of a at the place where the sequence ``name`` beside it holds ``elevator``, as in
                       ``sensor_msgs/JointState``; the place may differ from message to message
=====================  =====================================================================================
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from numbers import Integral, Real
from operator import attrgetter
from typing import Any

from msls_ros.estimation.errors import EstimationError, nearest
from msls_ros.inputs.synchronizer import Refused

_PART = re.compile(r"(?P<name>[A-Za-z_]\w*)(?:\[(?:(?P<index>\d+)|(?P<key>[A-Za-z_]\w*)=(?P<value>[^\[\]]+))\])?")
_AXES = {3: ("x", "y", "z"), 4: ("w", "x", "y", "z")}
_LONGEST = 500
"""Characters of a path."""
_LISTED = 8
"""Names shown in a sentence before it is cut short."""


class FieldPath:
    """A path, taken apart once and read from many messages.

    Parameters
    ----------
    text
        See the module.

    Raises
    ------
    EstimationError
        If the text is not a path.
    """

    def __init__(self, text: str) -> None:
        """Take the text apart; see the class."""
        if not text.isprintable():
            message = f"the path {text!r} holds what cannot be printed; expected NAME, NAME[2] or NAME[key=value]"
            raise EstimationError(message)
        if len(text) > _LONGEST:
            message = f"the path '{text[:40]}...' has {len(text)} characters; expected at most {_LONGEST}"
            raise EstimationError(message)
        self.text = text
        self._parts: list[_Part] = []
        for piece in _split(text):
            match = _PART.fullmatch(piece)
            if match is None:
                message = f"'{piece}' in the path '{text}' is not NAME, NAME[2] or NAME[key=value]"
                raise EstimationError(message)
            self._parts.append(_Part(match))
        plain = all(part.plain for part in self._parts)
        self._get: Callable[[Any], Any] | None = attrgetter(text) if plain else None

    def read(self, message: Any) -> Any:
        """Return what is at the path.

        Raises
        ------
        EstimationError
            If messages of this type have no such field.
        Refused
            If this message does not hold the element.
        """
        if self._get is not None:
            try:
                return self._get(message)
            except AttributeError:
                pass  # the walk below says where it ends
        value = message
        for part in self._parts:
            try:
                value = part.read(value)
            except AttributeError:
                raise EstimationError(self._no_field(message, part)) from None
            except (IndexError, TypeError) as error:
                text = f"{type(message).__name__}: {self.text}: {error}"
                raise Refused("field_missing", text) from None
        return value

    def write(self, message: Any, value: float) -> None:
        """Put a number where the path leads.

        Raises
        ------
        EstimationError, Refused
            As `read`, and where no real number stands; nothing has changed then.
        """
        found = self.read(message)
        if not isinstance(found, Real) or isinstance(found, Integral):  # a text or an integer would end the publisher
            text = f"the path '{self.text}' of {type(message).__name__} leads to {found!s:.40}; expected a real number"
            raise EstimationError(text)
        for part in self._parts[:-1]:
            message = part.read(message)
        self._parts[-1].write(message, value)

    def _no_field(self, message: Any, missing: _Part) -> str:
        """Say which part of the path does not exist, and what does."""
        value, walked = message, ""
        for part in self._parts:
            if part is missing:
                break
            value, walked = part.read(value), f"{walked}{'.' if walked else ''}{part.text}"
        name = next(n for n in (missing.name, missing.key) if n and not hasattr(value, n))
        where = f"'{walked}' of {type(message).__name__}" if walked else type(message).__name__
        fields = ", ".join(field_names(value)) or f"none, it is a {type(value).__name__}"
        near = nearest(name, field_names(value))
        return f"the path '{self.text}' does not exist: {where} has no field '{name}'; its fields are {fields}{near}"


class _Part:
    """One step of a path."""

    def __init__(self, match: re.Match[str]) -> None:
        self.text = match.group()
        self.name = match["name"]
        self.key, self.value = match["key"], match["value"]
        self._index = int(match["index"]) if match["index"] else -1
        self.plain = self.key is None and self._index < 0
        """Neither an element nor a key."""

    def read(self, owner: Any) -> Any:
        found = getattr(owner, self.name)
        if self.key is not None:
            return found[self._place(getattr(owner, self.key), len(found))]
        if self._index < 0:
            return found
        if self._index >= len(found):
            raise IndexError(f"'{self.name}' has {len(found)} elements; expected more than {self._index}")
        return found[self._index]

    def write(self, owner: Any, value: float) -> None:
        if self.key is None and self._index < 0:
            setattr(owner, self.name, value)
            return
        found = getattr(owner, self.name)
        found[self._index if self.key is None else self._place(getattr(owner, self.key), len(found))] = value

    def _place(self, names: Sequence[str], length: int) -> int:
        """Return where the name stands; it is looked for first where it was last."""
        place = self._index
        if not (0 <= place < len(names) and names[place] == self.value):
            place = next((i for i, name in enumerate(names) if name == self.value), -1)
            if place < 0:
                near = nearest(str(self.value), map(str, names))
                raise IndexError(f"'{self.key}' holds {listed(names)}; expected '{self.value}' among them{near}")
            self._index = place
        if place >= length:
            raise IndexError(f"'{self.name}' has {length} elements; expected one per '{self.key}', {len(names)}")
        return place


class VectorPath:
    """Where the components of a vector stand: one path to all of them, or one each, separated by commas.

    Parameters
    ----------
    text
        A path to an object with fields x, y, z (quaternions: w, x, y, z), to an array of as many numbers (quaternions:
        w first), or to a number each: ``vx,vy,vz``.
    size
        Components; 1 is a number.

    Raises
    ------
    EstimationError
        If the text is not that.
    """

    def __init__(self, text: str, size: int) -> None:
        """Take the text apart; see the class."""
        self.text, self.size = text, size
        self._getters: dict[type, Callable[[Any], Any]] = {}
        self._paths = [FieldPath(piece) for piece in text.split(",")]
        if len(self._paths) not in (1, size):
            message = f"'{text}' has {len(self._paths)} paths; expected 1 or {size}"
            raise EstimationError(message)

    def read(self, message: Any) -> tuple[float, ...]:
        """Return the components; quaternions w first.

        Raises
        ------
        EstimationError, Refused
            As `FieldPath.read`; also where there is something else than numbers.
        """
        found = [path.read(message) for path in self._paths]
        try:
            if len(self._paths) < self.size:
                get = self._getters.get(type(found[0]))
                if get is not None:
                    return tuple(map(float, get(found[0])))
            if len(found) == self.size:
                return tuple(map(float, found))
            return self._components(found[0])
        except (TypeError, ValueError, AttributeError):
            fields = ", ".join(field_names(found[0]))
            what = f"{type(found[0]).__name__}{f' with the fields {fields}' if fields else ''}"
            wanted = "a number" if self.size == 1 else f"{self.size} numbers"
            text = f"the path '{self.text}' leads to {what} in {type(message).__name__}; expected {wanted}"
            raise EstimationError(text) from None

    def _components(self, value: Any) -> tuple[float, ...]:
        axes = _AXES[self.size]
        if hasattr(value, "x"):
            if hasattr(value, "w") != ("w" in axes):
                raise TypeError
            values = tuple(float(getattr(value, axis)) for axis in axes)
            self._getters[type(value)] = attrgetter(*axes)
            return values
        if len(value) != self.size:
            raise ValueError
        return tuple(map(float, value))


def field_names(message: Any) -> list[str]:
    """Return the names of a message's fields; none: it is not a message."""
    if hasattr(message, "get_fields_and_field_types"):
        return list(message.get_fields_and_field_types())
    if hasattr(message, "__dataclass_fields__"):
        return [name for name in message.__dataclass_fields__ if not name.startswith("__")]
    return [name for name in getattr(message, "__dict__", {}) if not name.startswith("_")]


def listed(names: Iterable[str]) -> str:
    """Return names for a sentence, not more than a reader wants to see."""
    words = [f"'{name}'" for name in names]
    more = f" and {len(words) - _LISTED} more" if len(words) > _LISTED else ""
    return ", ".join(words[:_LISTED]) + more or "nothing"


def _split(text: str) -> list[str]:
    """Split at the dots that are not within brackets."""
    return re.split(r"\.(?![^\[]*\])", text)
