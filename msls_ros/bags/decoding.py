"""Deserialises the messages of a bag by the definitions that the bag itself holds."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from msls_ros.bags.definitions import Definition, Definitions, default_definitions
from msls_ros.bags.errors import BagError
from msls_ros.bags.serde import MISFITS, deserialize
from msls_ros.bags.storage import BagMessage, Topic
from msls_ros.bags.type_limits import check_text, check_types

_SEPARATOR = "=" * 80 + "\n"
_HEADER = "std_msgs/msg/Header"


class TypeDecoders:
    """One type store for each message type of a bag, so that two versions of a nested type never meet.

    Parameters
    ----------
    definition_paths : iterable of path
        Where to look for definitions that the bag does not hold.

    Attributes
    ----------
    refused : set of str
        Topics that `to_cdr` has warned of; clear it to be warned again.

    Raises
    ------
    BagError
        One of `definition_paths` is not a folder.
    """

    def __init__(self, definition_paths: Iterable[str | Path] = ()) -> None:
        extra = list(definition_paths)
        self._elsewhere = Definitions(extra) if extra else default_definitions()
        self._stores: dict[str, Typestore] = {}
        self._damaged: dict[str, str] = {}
        self.refused: set[str] = set()

    def decode(self, message: BagMessage, topic: Topic | None) -> Any:
        """Deserialise a message; see `BagReader.decode`.

        Parameters
        ----------
        message : BagMessage
            With CDR data.
        topic : Topic or None
            What the bag says of its topic.

        Returns
        -------
        object
            A `rosbags` message.

        Raises
        ------
        BagError
            No definition, or the bytes do not fit it.
        """
        store = self._stores.get(message.msgtype) or self._store(message.msgtype, topic)
        return deserialize(store, message.msgtype, message.data)

    def definition(self, topic: Topic) -> Definition:
        """Give the definition to write into another bag for the messages of a topic.

        Parameters
        ----------
        topic : Topic
            Of the bag.

        Returns
        -------
        Definition
            The bag's own where it has one; that of a ROS 1 type as ROS 2 would have it.

        Raises
        ------
        BagError
            There is none.
        """
        if topic.definition is None:
            return self._elsewhere.require(topic.msgtype)
        if topic.serialization == "cdr":
            return topic.definition
        store = self._stores.get(topic.msgtype) or self._store(topic.msgtype, topic)
        try:
            text, _ = store.generate_msgdef(topic.msgtype, ros_version=2)
            type_hash = store.hash_rihs01(topic.msgtype)
        except (TypesysError, KeyError, ValueError, AssertionError) as error:
            msg = f"{topic.msgtype}: its definition cannot be written for ROS 2: {error}"
            raise BagError(msg) from error
        return Definition(topic.msgtype, "ros2msg", text, type_hash)

    def to_cdr(
        self, batch: list[BagMessage], topics: Mapping[str, Topic], warn: Callable[[str], None]
    ) -> list[BagMessage]:
        """Convert ROS 1 messages to CDR, and leave out what is neither.

        Parameters
        ----------
        batch : list of BagMessage
            As the file holds them.
        topics : mapping of str to Topic
            What the bag says of them.
        warn : callable
            Gets one sentence for each topic that cannot be converted.

        Returns
        -------
        list of BagMessage
            `batch` itself where all of it is CDR.
        """
        if all(topics[message.topic].serialization == "cdr" for message in batch):
            return batch
        converted = []
        for message in batch:
            topic = topics[message.topic]
            try:
                converted.append(message if topic.serialization == "cdr" else self._from_ros1(message, topic))
            except BagError as error:
                if topic.name not in self.refused:
                    warn(f"topic {topic.name}: {error}; its messages are left out")
                    self.refused.add(topic.name)
        return converted

    def _from_ros1(self, message: BagMessage, topic: Topic) -> BagMessage:
        if topic.serialization != "ros1":
            msg = f"serialised as {topic.serialization!r}; expected cdr or ros1"
            raise BagError(msg)
        store = self._stores.get(message.msgtype) or self._store(message.msgtype, topic)
        try:
            data = bytes(store.ros1_to_cdr(message.data, message.msgtype))
        except (*MISFITS, IndexError, MemoryError) as error:
            msg = f"{message.msgtype}: {len(message.data)} bytes that are not a ROS 1 message of this type: {error}"
            raise BagError(msg) from error
        return message._replace(data=data)

    def _store(self, msgtype: str, topic: Topic | None) -> Typestore:
        if msgtype in self._damaged:  # to find that out once is dear enough
            raise BagError(self._damaged[msgtype])
        if topic is None or topic.definition is None:
            self._elsewhere.require(msgtype)
            store = self._elsewhere.store
        else:
            store = get_typestore(Stores.EMPTY)
            try:
                types = _parse(topic.definition)
                if topic.serialization == "ros1":
                    types.update(_ros2_header())
                check_types(msgtype, types)
                store.register(types)
                store.get_msgdef(msgtype)
            except BagError as error:
                self._damaged[msgtype] = str(error)
                raise
            except Exception as error:  # a parser and a generator of code, which fail in many ways
                what = (str(error).splitlines() or [""])[0][:200] or type(error).__name__
                msg = self._damaged[msgtype] = f"{msgtype}: the bag holds a damaged definition of this type: {what}"
                raise BagError(msg) from error
        self._stores[msgtype] = store
        return store


def _parse(definition: Definition) -> dict[str, Any]:
    """Parse the text of a definition with all that it uses."""
    check_text(definition.msgtype, definition.text, idl="idl" in definition.encoding)
    if definition.encoding in ("ros2msg", "ros1msg"):
        return dict(get_types_from_msg(definition.text, definition.msgtype))
    types: dict[str, Any] = {}
    for part in definition.text.split(_SEPARATOR):
        text = part.partition("\n")[2] if part.startswith("IDL: ") else part
        if text.strip():
            types.update(get_types_from_idl(text))
    return types


def _ros2_header() -> dict[str, Any]:
    """Give the header of ROS 2: that of ROS 1 has one field more, which conversion to CDR drops."""
    jazzy = get_typestore(Stores.ROS2_JAZZY).fielddefs
    return {name: jazzy[name] for name in (_HEADER, "builtin_interfaces/msg/Time")}
