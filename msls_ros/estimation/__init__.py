"""The method: factor update, MSLS, RLS, change detection, dither law, identifier. numpy and (optionally) numba only."""

from msls_ros.estimation.configuration import Configuration, from_mapping
from msls_ros.estimation.dither import Dither, DitherLaw, Level
from msls_ros.estimation.errors import EstimationError
from msls_ros.estimation.estimate import Estimate, EventKind, FaultEvent
from msls_ros.estimation.identifier import Identifier
from msls_ros.estimation.synchronizer import PairedSample, Refused, Synchronizer

__all__ = [
    "Configuration",
    "Dither",
    "DitherLaw",
    "Estimate",
    "EstimationError",
    "EventKind",
    "FaultEvent",
    "Identifier",
    "Level",
    "PairedSample",
    "Refused",
    "Synchronizer",
    "from_mapping",
]
