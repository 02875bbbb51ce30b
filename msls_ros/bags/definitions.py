"""Message definitions: from a type's name to its text, its hash and its (de)serialiser.

The fields of the standard types (`std_msgs`, `sensor_msgs`, `nav_msgs`, ...) are those of the ROS 2 Jazzy
set that comes with `rosbags`. Any other type, and the text with its comments, is looked for in this order:

1. folders the caller names: a `share` folder (`PKG/msg/X.msg`), or a package (`msg/X.msg`);
2. every prefix of `AMENT_PREFIX_PATH`: `share/PKG/msg/X.msg` (a sourced ROS 2 or colcon workspace);
3. `msg_defs/` beside this package, for `msls_msgs` in a source tree that is not built.

So bags are written and read with no ROS on the machine, and units and comments go into the bag
wherever they can be found.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from msls_ros.bags.errors import BagError
from msls_ros.bags.type_limits import MAX_DEPTH, check_text, check_types, members

_OURS = "msls_msgs"
_OURS_IN_SOURCE_TREE = Path(__file__).resolve().parents[2] / "msg_defs"
_SEPARATOR = "=" * 80


@dataclass(frozen=True)
class Definition:
    """What a bag stores about a message type.

    Attributes
    ----------
    msgtype : str
        Full name, `PKG/msg/NAME`.
    encoding : str
        `ros2msg` or `ros2idl`.
    text : str
        The definition followed by those of all types that it uses.
    type_hash : str
        `RIHS01_...`; empty: not known.
    """

    msgtype: str
    encoding: str
    text: str
    type_hash: str


class Definitions:
    """All definitions that can be found from here.

    Parameters
    ----------
    extra_paths : iterable of path
        Folders to look in first: `share` folders or package folders.

    Raises
    ------
    BagError
        One of `extra_paths` is not a folder.
    """

    def __init__(self, extra_paths: Iterable[str | Path] = ()) -> None:
        self._extra = [Path(path) for path in extra_paths]
        for path in self._extra:
            if not path.is_dir():
                msg = f"{path}: expected a folder with message definitions (PKG/msg/NAME.msg or msg/NAME.msg)"
                raise BagError(msg)
        self._texts: dict[str, str] = {}
        self._definitions: dict[str, Definition] = {}
        self._whole: set[str] = set()
        self.store: Typestore = get_typestore(Stores.ROS2_JAZZY)

    def require(self, msgtype: str) -> Definition:
        """Find a type, with all that it uses, and register it in `store`.

        Parameters
        ----------
        msgtype : str
            `PKG/msg/NAME`.

        Returns
        -------
        Definition
            Full text and type hash.

        Raises
        ------
        BagError
            The type, or one that it uses, has no definition; or the text cannot be parsed.
        """
        if msgtype not in self._definitions:
            self._register(msgtype, needed_by=None)
            names = list(self._walk(msgtype, {}))
            parts = [self._text(names[0])]
            parts += [f"{_SEPARATOR}\nMSG: {_short(name)}\n{self._text(name)}" for name in names[1:]]
            type_hash = self.store.hash_rihs01(msgtype)
            self._definitions[msgtype] = Definition(msgtype, "ros2msg", "\n".join(parts), type_hash)
        return self._definitions[msgtype]

    def require_package_of(self, msgtype: str) -> None:
        """Register every message type of the package that defines one type.

        Parameters
        ----------
        msgtype : str
            One of its types, `PKG/msg/NAME`.

        Raises
        ------
        BagError
            As `require`.
        """
        self.require(msgtype)
        path = self._find(msgtype)
        package = _split(msgtype)[0]
        for sibling in sorted(path.parent.glob("*.msg")) if path else ():
            self.require(f"{package}/msg/{sibling.stem}")

    def _register(self, msgtype: str, needed_by: str | None, trail: tuple[str, ...] = ()) -> None:
        if msgtype not in self.store.fielddefs:
            path = self._find(msgtype)
            if path is None:
                used = f" (used by {needed_by})" if needed_by else ""
                # ./msls, which sets the variable, takes nothing from the shell's workspaces.
                do = "name in MSLS_OVERLAY the install folder of" if "MSLS_OVERLAY" in os.environ else "source"
                msg = (
                    f"{msgtype}{used}: no message definition found; {do} the workspace that builds it, "
                    f"or give the folder that holds {'/'.join(_split(msgtype))}.msg"
                )
                raise BagError(msg)
            try:
                text = path.read_text(encoding="utf-8")
                check_text(msgtype, text, idl=False)
                types = get_types_from_msg(text, msgtype)
                check_types(msgtype, types)
                self.store.register(types)
            except Exception as error:  # a parser and a generator of code, which fail in many ways
                what = (str(error).splitlines() or [""])[0][:200] or type(error).__name__
                msg = f"{path}: not a readable message definition of {msgtype}: {what}"
                raise BagError(msg) from error
        trail = (*trail, msgtype)
        if len(trail) > MAX_DEPTH:
            msg = f"{trail[0]}: types more than {MAX_DEPTH} deep in one another"
            raise BagError(msg)
        for name in self._members(msgtype):
            if name in trail:
                msg = f"{msgtype}: its type {name} holds itself"
                raise BagError(msg)
            if name not in self._whole:
                self._register(name, needed_by=msgtype, trail=trail)
        self._whole.add(msgtype)

    def _walk(self, msgtype: str, seen: dict[str, None]) -> dict[str, None]:
        """Give a type and all that it uses, each once, the users first."""
        seen[msgtype] = None
        for name in self._members(msgtype):
            if name not in seen:
                self._walk(name, seen)
        return seen

    def _members(self, msgtype: str) -> list[str]:
        return members(self.store.fielddefs[msgtype][1])

    def _text(self, msgtype: str) -> str:
        if msgtype not in self._texts:
            path = self._find(msgtype)
            if path is not None and self._agrees(path, msgtype):
                self._texts[msgtype] = path.read_text(encoding="utf-8")
            else:
                generated, _ = self.store.generate_msgdef(msgtype, ros_version=2)
                self._texts[msgtype] = generated.split(f"{_SEPARATOR}\n")[0]
        return self._texts[msgtype]

    def _agrees(self, path: Path, msgtype: str) -> bool:
        """Whether the text on disk defines the fields that the store (de)serialises."""
        try:
            parsed = get_types_from_msg(path.read_text(encoding="utf-8"), msgtype)
        except (TypesysError, OSError, ValueError, AssertionError):
            return False
        have = [(name.lower(), kind) for name, kind in self.store.fielddefs[msgtype][1]]
        return [(name.lower(), kind) for name, kind in parsed[msgtype][1]] == have

    def _find(self, msgtype: str) -> Path | None:
        package, kind, name = _split(msgtype)
        candidates: list[Path] = []
        for path in self._extra:
            candidates += [path / package / kind / f"{name}.msg", path / kind / f"{name}.msg"]
        for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
            if prefix:
                candidates.append(Path(prefix) / "share" / package / kind / f"{name}.msg")
        if package == _OURS:
            candidates.append(_OURS_IN_SOURCE_TREE / kind / f"{name}.msg")
        return next((path for path in candidates if path.is_file()), None)


def typestore(extra_paths: Iterable[str | Path] = ()) -> Typestore:
    """Make a `rosbags` type store: ROS 2 Jazzy, `msls_msgs`, and every type below `extra_paths`.

    Parameters
    ----------
    extra_paths : iterable of path
        `share` folders (`PKG/msg/NAME.msg`) or package folders (`msg/NAME.msg`).

    Returns
    -------
    rosbags.typesys.store.Typestore
        For `serialize_cdr`, `deserialize_cdr` and `types`.

    Raises
    ------
    BagError
        A path is not a folder, or a definition, or one that it uses, is missing or unreadable.
    """
    definitions = Definitions(extra_paths)
    definitions.require_package_of(f"{_OURS}/msg/StateSample")
    for folder in map(Path, extra_paths):
        for path in sorted([*folder.glob("*/msg/*.msg"), *folder.glob("msg/*.msg")]):
            package = path.parent.parent.resolve().name
            definitions.require(f"{package}/msg/{path.stem}")
    return definitions.store


@lru_cache(maxsize=1)
def _cached(_ament_prefix_path: str) -> Definitions:
    return Definitions()


def default_definitions() -> Definitions:
    """Give the definitions that need no extra folder; one object per environment.

    Returns
    -------
    Definitions
        Shared: do not register other types in its store.
    """
    return _cached(os.environ.get("AMENT_PREFIX_PATH", ""))


def _split(msgtype: str) -> tuple[str, str, str]:
    parts = msgtype.split("/")
    if len(parts) != 3 or parts[1] != "msg" or not all(part.isidentifier() for part in parts):
        msg = f"{msgtype!r}: not the name of a message type; expected PACKAGE/msg/NAME"
        raise BagError(msg)
    return parts[0], parts[1], parts[2]


def _short(msgtype: str) -> str:
    package, _, name = _split(msgtype)
    return f"{package}/{name}"
