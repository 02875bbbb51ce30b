"""The method, and nothing else: from samples to A, B, their error bars, alarms and dither.

Square-root least squares with a penalty on parameter change (MSLS, eqs 6-14 of the paper), change detection (eqs
18-19), isolation, error bars and active noise injection (eqs 20-23). This room imports numpy and, where it is
installed, numba; no other room, and no ROS. Begin with `identifier.Identifier`, which is the whole of it for one
aircraft; then `kernel` (one update of a factor), `rows` (equations that share a history) and `detection`.
"""

from msls_ros.estimation.configuration import Configuration, from_mapping
from msls_ros.estimation.dither import DitherLaw
from msls_ros.estimation.dither.answer import Dither, DitherBlock, Level
from msls_ros.estimation.errors import EstimationError
from msls_ros.estimation.estimate import Estimate, EventKind, FaultEvent
from msls_ros.estimation.identifier import Identifier, Run
from msls_ros.estimation.msls import MSLS, RLS
from msls_ros.estimation.regression import Regression, make_settings
from msls_ros.estimation.samples import LARGEST

__all__ = [
    "LARGEST",
    "MSLS",
    "RLS",
    "Configuration",
    "Dither",
    "DitherBlock",
    "DitherLaw",
    "Estimate",
    "EstimationError",
    "EventKind",
    "FaultEvent",
    "Identifier",
    "Level",
    "Regression",
    "Run",
    "from_mapping",
    "make_settings",
]
