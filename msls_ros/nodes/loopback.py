"""DDS that stays on this machine and leaves nothing in shared memory.

A process that is killed leaves its ports of Fast DDS in shared memory, and the next one that sends there can hang in
``SharedMemManager::Port::regenerate_port`` for good (seen here on Linux) or be taken down, which no exception says
(https://github.com/eProsima/Fast-DDS/issues/6501). ``ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST`` opens shared memory
whatever ``FASTDDS_BUILTIN_TRANSPORTS`` says; what keeps it shut is a profile of its own, ``config/dds_loopback.xml``.
Fast DDS reads that once, with the first participant of a process.
"""

from __future__ import annotations

import os

from msls_ros.inputs.profiles import config_folder

RANGE, PROFILE = "ROS_AUTOMATIC_DISCOVERY_RANGE", "FASTRTPS_DEFAULT_PROFILES_FILE"
BY_PROFILE = "SYSTEM_DEFAULT"
"""The range by which the profile alone decides."""


def loopback() -> dict[str, str]:
    """Return the environment of processes whose DDS goes by UDP over the loopback interface alone."""
    return {PROFILE: str(config_folder() / "dds_loopback.xml"), RANGE: BY_PROFILE}


def stay_on_this_machine() -> None:
    """Keep the DDS of this process, which has none yet, and of those it starts on this machine.

    Without shared memory where DDS is Fast DDS; what the environment says of range or profile already stays.
    """
    fast = os.environ.get("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp").startswith("rmw_fastrtps")
    if fast and RANGE not in os.environ and PROFILE not in os.environ:
        os.environ.update(loopback())
    os.environ.setdefault(RANGE, "LOCALHOST")
