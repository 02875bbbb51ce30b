"""Bags: written so that a kill loses at most the last second, read whatever state they are in.

rosbag2 (MCAP and sqlite3) and ROS 1 files, whole or damaged. This room imports rosbags, mcap and their codecs, and no
other room. Begin with `reader.BagReader` and `writer.BagWriter`; each storage has its own scanner.
"""

from __future__ import annotations

from msls_ros.bags.definitions import Definition, Definitions, typestore
from msls_ros.bags.errors import BagError
from msls_ros.bags.limits import HELD
from msls_ros.bags.metadata import Qos
from msls_ros.bags.reader import BagReader, read
from msls_ros.bags.repair import Repair, repair
from msls_ros.bags.replacing import replacing
from msls_ros.bags.samples import Sample, SampleBlock, SampleDecoder
from msls_ros.bags.storage import BagMessage, Summary, Topic
from msls_ros.bags.template import MessageTemplate
from msls_ros.bags.writer import BagWriter, check_replaceable

__all__ = [
    "HELD",
    "BagError",
    "BagMessage",
    "BagReader",
    "BagWriter",
    "Definition",
    "Definitions",
    "MessageTemplate",
    "Qos",
    "Repair",
    "Sample",
    "SampleBlock",
    "SampleDecoder",
    "Summary",
    "Topic",
    "check_replaceable",
    "read",
    "repair",
    "replacing",
    "typestore",
]
