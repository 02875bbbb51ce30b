"""Control laws that redesign themselves from the identified A and B.

This room imports `estimation` and numba, no ROS. Begin with `controller.Controller`: samples, a pilot's command and
the identified model in, deflections out. `indi` is the law that flies, `believed` what it believes of the effectors,
`allocation` how the surfaces share the work, `lq_servo` the rival, `supervisor` which law flies and why.
"""

from msls_ros.control.aircraft import AXES, ControlledAircraft, Prior
from msls_ros.control.controller import Controller
from msls_ros.control.errors import ControlError
from msls_ros.control.settings import LAWS, ControlSettings
from msls_ros.control.signals import Margins, ModelEstimate, PilotCommand, Status

__all__ = [
    "AXES",
    "LAWS",
    "ControlError",
    "ControlSettings",
    "ControlledAircraft",
    "Controller",
    "Margins",
    "ModelEstimate",
    "PilotCommand",
    "Prior",
    "Status",
]
