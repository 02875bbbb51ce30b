"""What a message definition from outside may ask for: checked before code is made of it.

`rosbags` writes out a function per type, with a line for each element of an array of messages: a bound of 2e9, or a
type that holds itself, would fill the memory or the stack.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

from rosbags.interfaces import Nodetype

from msls_ros.bags.errors import BagError

MAX_TEXT = 1 << 20
"""Characters of a definition with all that it uses."""
MAX_LINES = 5000
"""Lines of it that are neither empty nor comments; those of the largest message of PX4: 120."""
MAX_FIELDS = 5000
"""Fields of all types of a definition."""
MAX_UNROLLED = 5000
"""Elements of all its arrays of messages or texts, each of which is a line of code."""
MAX_BYTES = 1 << 28
"""Of an array of numbers."""
MAX_DEPTH = 32
"""Types within types."""
_TYPE_NAME = re.compile(r"[A-Za-z]\w*(/[A-Za-z]\w*)+", re.ASCII)
_SHIFT = re.compile(r"<<|\d{20}")


def check_text(msgtype: str, text: str, *, idl: bool) -> None:
    """Refuse a text that takes long to parse.

    Parameters
    ----------
    msgtype : str
        Its type, for the sentence.
    text : str
        The definition with all that it uses.
    idl : bool
        It is IDL, whose bounds may be computed.

    Raises
    ------
    BagError
        It is too long, or the name is none of a type.
    """
    if not _TYPE_NAME.fullmatch(msgtype):
        _refuse(msgtype, "not the name of a message type; expected PACKAGE/msg/NAME")
    if len(text) > MAX_TEXT:
        _refuse(msgtype, f"a definition of {len(text)} characters; expected at most {MAX_TEXT}")
    lines = sum(1 for line in text.splitlines() if (bare := line.strip()) and not bare.startswith(("#", "//")))
    if lines > MAX_LINES:
        _refuse(msgtype, f"a definition of {lines} lines; expected at most {MAX_LINES}")
    if idl and _SHIFT.search(text):
        _refuse(msgtype, "a definition with a shifted or enormous number; expected plain bounds")


def check_types(msgtype: str, types: Mapping[str, Any]) -> None:
    """Refuse types of which no sensible code can be made.

    Parameters
    ----------
    msgtype : str
        The type that is wanted.
    types : mapping
        Constants and fields by type, as `rosbags` parses them.

    Raises
    ------
    BagError
        Too many fields, too large bounds, too deep, or a type that holds itself.
    """
    fields = sum(len(fields) for _, fields in types.values())
    if fields > MAX_FIELDS:
        _refuse(msgtype, f"a definition of {fields} fields; expected at most {MAX_FIELDS}")
    unrolled = sum(_check_bounds(name, described) for name, (_, described) in types.items())
    if unrolled > MAX_UNROLLED:
        _refuse(msgtype, f"arrays of {unrolled} messages or texts; expected at most {MAX_UNROLLED}")
    _check_nesting(msgtype, lambda name: members(types[name][1]) if name in types else [])


def _check_nesting(msgtype: str, inside: Callable[[str], list[str]]) -> None:
    """Refuse a type that holds itself, or types too deep in one another.

    Parameters
    ----------
    msgtype : str
        The outermost type.
    inside : callable
        Gives the types among the fields of a type.

    Raises
    ------
    BagError
        Naming the type.
    """
    depths: dict[str, int] = {}

    def depth(name: str, trail: tuple[str, ...]) -> int:
        if name in trail:
            _refuse(msgtype, f"its type {name} holds itself")
        if len(trail) > MAX_DEPTH:
            _refuse(msgtype, f"types more than {MAX_DEPTH} deep in one another")
        if name not in depths:
            depths[name] = 1 + max((depth(one, (*trail, name)) for one in inside(name)), default=0)
        return depths[name]

    if depth(msgtype, ()) > MAX_DEPTH:
        _refuse(msgtype, f"types more than {MAX_DEPTH} deep in one another")


def members(fields: Any) -> list[str]:
    """Give the message types among fields.

    Parameters
    ----------
    fields : iterable
        Names and kinds, as `rosbags` has them.

    Returns
    -------
    list of str
        Once for each field.
    """
    names: list[str] = []
    for _, field in fields:
        kind: Any = field
        while kind[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            kind = kind[1][0]
        if kind[0] == Nodetype.NAME:
            names.append(kind[1])
    return names


def _check_bounds(name: str, fields: Any) -> int:
    """Check arrays; give how many elements of them are messages or texts."""
    unrolled = 0
    for field, kind in fields:
        if kind[0] != Nodetype.ARRAY:
            continue
        element, length = kind[1]
        if element[0] == Nodetype.BASE and element[1][0] != "string":
            if not 0 <= length <= MAX_BYTES // 8:
                _refuse(name, f"field {field}: an array of {length}; expected at most {MAX_BYTES // 8}")
            continue
        if not 0 <= length <= MAX_UNROLLED:
            _refuse(name, f"field {field}: an array of {length} messages or texts; expected at most {MAX_UNROLLED}")
        unrolled += length
    return unrolled


def _refuse(msgtype: str, what: str) -> None:
    msg = f"{msgtype[:100]}: {what}"
    raise BagError(msg)
