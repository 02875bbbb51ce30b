"""What the readers of the storage formats have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from msls_ros.bags.definitions import Definition


class BagMessage(NamedTuple):
    """One message of a bag, still serialised.

    A named tuple, not a dataclass: making one costs 0.2 instead of 0.6 microseconds, and a bag has
    millions.

    Attributes
    ----------
    topic, msgtype : str
        Name and type (`PKG/msg/NAME`) of the topic.
    stamp_ns : int
        Log time: when it was recorded [ns].
    data : bytes
        CDR with its 4 bytes of encapsulation. (Within this room, before `BagReader` converts it:
        as the file holds it.)
    """

    topic: str
    msgtype: str
    stamp_ns: int
    data: bytes


@dataclass(frozen=True)
class Topic:
    """A topic as the storage file describes it.

    Attributes
    ----------
    name, msgtype : str
        Topic and type.
    serialization : str
        `cdr` or `ros1`.
    definition : Definition, optional
        Of the type, where the file holds it.
    qos : str
        YAML of the offered QoS profiles; empty: not known.
    """

    name: str
    msgtype: str
    serialization: str
    definition: Definition | None
    qos: str


@dataclass(frozen=True)
class Summary:
    """What a storage file says about itself, without reading its messages.

    Attributes
    ----------
    counts : dict of str to int
        Messages by topic.
    start_ns, end_ns : int
        First and last log time [ns]; 0 and 0 where there is no message.
    """

    counts: dict[str, int]
    start_ns: int
    end_ns: int


class Scanner(Protocol):
    """Reads one storage file from the front to the back."""

    @property
    def topics(self) -> list[Topic]:
        """All topics met so far; those of the index from the start."""
        ...

    @property
    def summary(self) -> Summary | None:
        """None where the file has no (readable) index."""
        ...

    @property
    def lost(self) -> bool:
        """Whether anything was written, as far as it has been read, that cannot be; an end that is cut off is not."""
        ...

    def batches(self, wanted: Callable[[str], bool], warn: Callable[[str], None]) -> Iterator[list[BagMessage]]:
        """Yield messages in the order in which they were written, some at a time.

        Damage never raises: what is readable is yielded and `warn` gets half a sentence for each kind
        of damage; the reader puts the name of the file before them.

        Parameters
        ----------
        wanted : callable
            Whether a topic is to be read.
        warn : callable
            Gets half a sentence for each kind of damage.

        Yields
        ------
        list of BagMessage
            In the order in which they were written.
        """
        ...

    def progress(self) -> float:
        """Give the share of the file that has been read, 0 to 1."""
        ...

    def close(self) -> None:
        """Close the file."""
        ...


def normalize_type(name: str) -> str:
    """Write a type as `PKG/msg/NAME`.

    Parameters
    ----------
    name : str
        `PKG/NAME` (ROS 1) or `PKG/msg/NAME`.

    Returns
    -------
    str
        The long form.
    """
    package, _, rest = name.partition("/")
    return name if "/" in rest or not rest else f"{package}/msg/{rest}"
