"""From a file to the scanner of its format; the first bytes say which."""

from __future__ import annotations

import os
from pathlib import Path
from typing import BinaryIO

from msls_ros.bags.errors import BagError
from msls_ros.bags.mcap_scan import MAGIC as MCAP_MAGIC
from msls_ros.bags.mcap_scan import McapScanner
from msls_ros.bags.storage import Scanner

_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


def open_storage(path: Path, message_compression: bool) -> Scanner:
    """Open one storage file.

    Parameters
    ----------
    path : Path
        The file.
    message_compression : bool
        Its messages are compressed one by one.

    Returns
    -------
    Scanner
        To be closed by the caller.

    Raises
    ------
    BagError
        Not a file that can be read, or not of a known format.
    """
    try:
        stream = path.open("rb")
        head = stream.read(16)
        stream.seek(0)
    except OSError as error:
        msg = f"{path}: cannot be read: {error.strerror or error}"
        raise BagError(msg) from error
    size: int | None = os.fstat(stream.fileno()).st_size
    try:
        source: BinaryIO = stream
        if head.startswith(MCAP_MAGIC):
            return McapScanner(path, source, size)
    except BaseException:
        stream.close()
        raise
    stream.close()
    msg = f"{path}: not a bag; expected an MCAP, sqlite3 or ROS 1 bag file{' (it is empty)' if not head else ''}"
    raise BagError(msg)
