"""The method: factor update, MSLS, RLS, change detection, dither law, identifier. numpy and (optionally) numba only."""

from msls_ros.estimation.configuration import Configuration, from_mapping
from msls_ros.estimation.dither import Dither, DitherBlock, DitherLaw, Level
from msls_ros.estimation.errors import EstimationError
from msls_ros.estimation.estimate import Estimate, EventKind, FaultEvent
from msls_ros.estimation.identifier import Identifier, Run
from msls_ros.estimation.msls import MSLS, RLS
from msls_ros.estimation.regression import Regression, make_settings
from msls_ros.estimation.synchronizer import NamedVector, PairedSample, Refused, Synchronizer

__all__ = [
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
    "NamedVector",
    "PairedSample",
    "Refused",
    "Regression",
    "Run",
    "Synchronizer",
    "from_mapping",
    "make_settings",
]
