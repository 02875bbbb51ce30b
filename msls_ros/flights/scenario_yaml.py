"""YAML of scenarios and aircraft, read strictly: one sentence says file, key, what was found and expected."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NoReturn

import yaml


class ScenarioError(ValueError):
    """A scenario cannot be used: one sentence, what was found and what was expected."""


SCENARIO, AIRCRAFT = "scenario file", "aircraft file"
"""What the sentences call a file."""


class Section:
    """A mapping of a file.

    Parameters
    ----------
    file
        For the sentences.
    key
        Dotted name of the section; empty: the whole file.
    values
        What the file has there.
    known
        The keys that it may have; empty: any.
    kind
        What the sentences call the file.

    Raises
    ------
    ScenarioError
        If it is no mapping, or has a key that is not known.
    """

    def __init__(self, file: Path, key: str, values: Any, known: Iterable[str] = (), kind: str = SCENARIO) -> None:
        self.file, self.key, self.kind = file, key, kind
        if not isinstance(values, Mapping):
            self.refuse(None, f"is {shown(values)}; expected a section of keys")
        self.values: Mapping[str, Any] = values
        names = tuple(known)
        for name in values:
            if not isinstance(name, str) or (names and name not in names):
                self.refuse(str(name), f"is unknown; expected {suggestion(str(name), names)}")

    def refuse(self, name: str | None, text: str) -> NoReturn:
        """Raise ScenarioError about a key, or about the section itself."""
        key = ".".join(part for part in (self.key, name) if part)
        raise ScenarioError(f"{self.kind} '{self.file}': {f'{key} ' if key else ''}{text}")

    def wrap(self, name: str, error: Exception) -> NoReturn:
        """Raise ScenarioError of what another said about a key."""
        key = ".".join(part for part in (self.key, name) if part)
        message = f"{self.kind} '{self.file}': {key}: {error}"
        raise ScenarioError(message) from error

    def get(self, name: str, default: Any, expected: str) -> Any:
        """Return the value of a key; a default of None is none: the key must be there."""
        if name not in self.values:
            if default is None:
                self.refuse(name, f"is missing; expected {expected}")
            return default
        return self.values[name]

    def text(self, name: str, expected: str, default: str | None = None) -> str:
        """Return a line of text."""
        value = self.get(name, default, expected)
        if not isinstance(value, str) or not value.strip() or "\n" in value.strip():
            self.refuse(name, f"is {shown(value)}; expected {expected}")
        return value.strip()

    def word(self, name: str, choices: Iterable[str], default: str | None = None) -> str:
        """Return one of some words."""
        words = tuple(choices)
        value = self.get(name, default, f"one of {', '.join(words)}")
        if value not in words:
            self.refuse(name, f"is {shown(value)}; expected {suggestion(value, words)}")
        return str(value)

    def number(self, name: str, low: float, high: float, unit: str, default: float | None = None) -> float:
        """Return a number within a range."""
        expected = f"a number from {low:g} to {high:g}{f' {unit}' if unit else ''}"
        value = self.get(name, default, expected)
        if isinstance(value, str) and _is_float(value):
            self.refuse(name, f"is the word '{value}'; expected {expected}, as YAML has them: 1.0e-3, not 1e-3")
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
            self.refuse(name, f"is {shown(value)}; expected {expected}")
        return float(value)

    def whole(self, name: str, low: int, high: int, unit: str, default: int) -> int:
        """Return a whole number within a range."""
        value = self.number(name, low, high, unit, default)
        if not value.is_integer():
            self.refuse(name, f"is {value!r}; expected a whole number from {low} to {high} {unit}")
        return int(value)

    def flag(self, name: str, default: bool) -> bool:
        """Return true or false."""
        value = self.values.get(name, default)
        if not isinstance(value, bool):
            self.refuse(name, f"is {shown(value)}; expected true or false")
        return value

    def section(self, name: str, known: Iterable[str] = (), default: Mapping[str, Any] | None = None) -> Section:
        """Return a section within this one."""
        key = f"{self.key}.{name}" if self.key else name
        return Section(self.file, key, self.get(name, default, "a section of keys"), known, self.kind)

    def sections(self, name: str, known: Iterable[str]) -> list[Section]:
        """Return a list of sections; none where the key is not there."""
        values = self.values.get(name, [])
        if not isinstance(values, list):
            self.refuse(name, f"is {shown(values)}; expected a list, [] for none")
        return [Section(self.file, f"{name}[{i}]", value, known, self.kind) for i, value in enumerate(values)]


def load(file: Path, kind: str = SCENARIO) -> Any:
    """Return what a YAML file holds.

    Parameters
    ----------
    file
        Its path.
    kind
        What the sentences call it.

    Raises
    ------
    ScenarioError
        If it cannot be read, is no YAML, or has a key twice.
    """
    try:
        text = file.read_text(encoding="utf-8")
        _refuse_twins(file, yaml.compose(text, yaml.SafeLoader), "", kind)
        return yaml.safe_load(text)
    except OSError as error:
        message = f"{kind} '{file}' cannot be read: {error.strerror}"
        raise ScenarioError(message) from error
    except RecursionError as error:
        message = f"{kind} '{file}' is nested without end; expected a section of keys"
        raise ScenarioError(message) from error
    except (yaml.YAMLError, ValueError, AttributeError, TypeError) as error:
        if isinstance(error, ScenarioError):
            raise
        message = f"{kind} '{file}' is not YAML: {' '.join(str(error).split())}"
        raise ScenarioError(message) from error


def _refuse_twins(file: Path, node: Any, key: str, kind: str) -> None:
    """Raise ScenarioError where a mapping has a key twice, of which YAML would keep the last."""
    if isinstance(node, yaml.SequenceNode):
        for i, child in enumerate(node.value):
            _refuse_twins(file, child, f"{key}[{i}]", kind)
    if not isinstance(node, yaml.MappingNode):
        return
    seen: dict[str, int] = {}
    for name, child in node.value:
        line, word = name.start_mark.line + 1, str(name.value)
        dotted = f"{key}.{word}" if key else word
        if word in seen:
            message = f"{kind} '{file}': {dotted} stands in line {seen[word]} and in line {line}; expected once"
            raise ScenarioError(message)
        seen[word] = line
        _refuse_twins(file, child, dotted, kind)


def shown(value: Any) -> str:
    """Return a value of a file for a sentence."""
    if value is None:
        return "empty"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (str, int, float)):
        text = repr(value)
        return text if len(text) <= 60 else f"{text[:57]}..."
    if isinstance(value, (dict, list)):
        return "a section" if isinstance(value, dict) else "a list"
    return f"a {type(value).__name__}"


LISTED = 40
"""So many names, at most, are listed in a sentence."""


def suggestion(found: object, known: Iterable[str]) -> str:
    """Return the names that would be right, the likely one first where one is."""
    names = tuple(known)
    if not names:
        return "a word"
    close = difflib.get_close_matches(found, names, 1) if isinstance(found, str) else []
    if close:
        return f"'{close[0]}'" if len(names) > LISTED else f"'{close[0]}', or another of {', '.join(names)}"
    return f"one of {', '.join(names)}" if len(names) <= LISTED else f"one such as '{names[0]}'"


def _is_float(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
