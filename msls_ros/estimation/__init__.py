"""The method: factor update, MSLS, RLS, change detection, dither law, identifier. numpy and (optionally) numba only."""

from msls_ros.estimation.configuration import Configuration, from_mapping
from msls_ros.estimation.dither import Dither, DitherBlock, DitherLaw, Level
from msls_ros.estimation.errors import EstimationError
from msls_ros.estimation.estimate import Estimate, EventKind, FaultEvent
from msls_ros.estimation.identifier import Identifier, Run
from msls_ros.estimation.input_map import InputMap
from msls_ros.estimation.inputs import EffectorRow, InputAdapter, StateRow, adapt
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
    "EffectorRow",
    "Estimate",
    "EstimationError",
    "EventKind",
    "FaultEvent",
    "Identifier",
    "InputAdapter",
    "InputMap",
    "Level",
    "NamedVector",
    "PairedSample",
    "Refused",
    "Regression",
    "Run",
    "StateRow",
    "Synchronizer",
    "adapt",
    "from_mapping",
    "make_settings",
]
