"""Reads the YAML of bags: small, shallow, and without what a few lines of it can unfold to.

Anchors and merge keys (`*a`, `<<: *a`) name a value once more, and so a page of them stands for more values than any
memory holds. They are counted before anything is built.
"""

from __future__ import annotations

from copy import deepcopy
from functools import lru_cache
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.events import AliasEvent, CollectionEndEvent, CollectionStartEvent, NodeEvent

MAX_DEPTH = 32
MAX_VALUES = 200_000
_PLAIN_BRACKETS = 32


class YamlError(Exception):
    """A text is no YAML, or more than is read."""


def check(text: str, limit: int) -> None:
    """Refuse a YAML text that is too much for any reader.

    Parameters
    ----------
    text : str
        YAML.
    limit : int
        How long it may be [characters].

    Raises
    ------
    YamlError
        It is not YAML, or too long, too deep, or unfolds to too much.
    """
    _check_length(text, limit)
    try:
        _check(text)
    except YamlError:
        raise
    except Exception as error:
        raise _unreadable(error) from error


def load(text: str, limit: int) -> Any:
    """Read a YAML text of a bag.

    Parameters
    ----------
    text : str
        YAML.
    limit : int
        How long it may be [characters].

    Returns
    -------
    object
        Mappings, lists and scalars.

    Raises
    ------
    YamlError
        It is not YAML, or too long, too deep, or unfolds to too much.
    """
    _check_length(text, limit)
    try:
        if "&" in text or "*" in text or text.count("[") + text.count("{") > _PLAIN_BRACKETS:
            _check(text)
        return deepcopy(_parse(text))
    except YamlError:
        raise
    except Exception as error:  # of odd scalars it raises nearly everything there is
        raise _unreadable(error) from error


@lru_cache(maxsize=16)
def _parse(text: str) -> Any:
    """Read a text that is small and shallow; a bag is opened several times on the way to its page, at 0.1 s each."""
    return YAML(typ="safe", pure=True).load(text)


def _unreadable(error: Exception) -> YamlError:
    lines = str(error).splitlines() or [type(error).__name__]
    return YamlError(f"not readable as YAML: {lines[0]}")


def _check_length(text: str, limit: int) -> None:
    if len(text) > limit:
        msg = f"more than {limit} characters"
        raise YamlError(msg)


def _check(text: str) -> None:
    """Count values, those behind anchors as often as they are named, and levels."""
    sizes: dict[str, int] = {}
    opened: list[tuple[str | None, int]] = []
    count = 0
    for event in YAML(typ="safe", pure=True).parse(text):
        if isinstance(event, AliasEvent):
            if event.anchor not in sizes:
                msg = f"the alias {event.anchor!r} names what does not stand before it"
                raise YamlError(msg)
            count += sizes[event.anchor]
        elif isinstance(event, CollectionStartEvent):
            opened.append((event.anchor, count))
            count += 1
        elif isinstance(event, CollectionEndEvent):
            anchor, before = opened.pop()
            if anchor is not None:
                sizes[anchor] = count - before
        elif isinstance(event, NodeEvent):
            count += 1
            if event.anchor is not None:
                sizes[event.anchor] = 1
        if len(opened) > MAX_DEPTH:
            msg = f"more than {MAX_DEPTH} levels deep"
            raise YamlError(msg)
        if count > MAX_VALUES:
            msg = f"its aliases unfold to more than {MAX_VALUES} values"
            raise YamlError(msg)
