"""Bags: written so that a kill loses at most the last second, read whatever state they are in.

rosbag2 (MCAP and sqlite3) and ROS 1 files, whole or damaged; logs of PX4 and ArduPilot. This room imports rosbags, mcap
and their codecs, pyulog where there is a log of PX4, and no other room. Begin with `reader.BagReader` and
`writer.BagWriter`; each storage has its own scanner. Logs become tables: `any_log.open_any` opens whatever it is given.
"""

from __future__ import annotations

from msls_ros.bags.any_log import AnyReader, open_any
from msls_ros.bags.definitions import Definition, Definitions, typestore
from msls_ros.bags.errors import BagError
from msls_ros.bags.limits import HELD
from msls_ros.bags.metadata import Qos
from msls_ros.bags.reader import BagReader, read
from msls_ros.bags.repair import Repair, repair
from msls_ros.bags.replacing import replacing
from msls_ros.bags.samples import Sample, SampleBlock, SampleDecoder
from msls_ros.bags.storage import BagMessage, Summary, Topic
from msls_ros.bags.tables import FlightLog, LogReader
from msls_ros.bags.template import MessageTemplate
from msls_ros.bags.writer import BagWriter, check_replaceable

__all__ = [
    "HELD",
    "AnyReader",
    "BagError",
    "BagMessage",
    "BagReader",
    "BagWriter",
    "Definition",
    "Definitions",
    "FlightLog",
    "LogReader",
    "MessageTemplate",
    "Qos",
    "Repair",
    "Sample",
    "SampleBlock",
    "SampleDecoder",
    "Summary",
    "Topic",
    "check_replaceable",
    "open_any",
    "read",
    "repair",
    "replacing",
    "typestore",
]
