"""One door for all recordings: bags of ROS, logs of PX4 and of ArduPilot."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from msls_ros.bags import dataflash, ulog
from msls_ros.bags.errors import BagError
from msls_ros.bags.limits import HELD
from msls_ros.bags.reader import BagReader
from msls_ros.bags.tables import LogReader

AnyReader = BagReader | LogReader
"""What gives messages."""


def open_any(path: str | Path, *, definition_paths: Iterable[str | Path] = (), held: int = HELD) -> AnyReader:
    """Open a bag, or a log of PX4 (.ulg) or ArduPilot (.bin); the first bytes say which.

    Parameters
    ----------
    path : path
        A bag directory or file, or a log.
    definition_paths, held
        As of `BagReader`.

    Raises
    ------
    BagError
        Nothing there, or none of these.
    """
    place = Path(path)
    if place.is_file():
        try:
            with place.open("rb") as stream:
                head = stream.read(16)
            size = place.stat().st_size
        except OSError as error:
            msg = f"{place}: cannot be read: {error.strerror or error}"
            raise BagError(msg) from error
        for module in (ulog, dataflash):
            if head.startswith(module.MAGIC):
                if size > held:
                    msg = (
                        f"{place}: {size >> 20} MiB; a log is held as a whole, {held >> 20} MiB are allowed (--memory)"
                    )
                    raise BagError(msg)
                return LogReader(module.read(place))
    return BagReader(place, definition_paths=definition_paths, held=held)
