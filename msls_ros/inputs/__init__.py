"""Anybody's messages become samples: paired by stamp, checked, mapped by field paths, differentiated, aligned.

The gate stands before the identifier wherever it runs: in the node, offline and in tests. The parameter files that say
what to expect are read here too. This room imports `estimation` (its errors, configuration and kernels); it knows no
ROS and no bag. Begin with `synchronizer.Synchronizer` (messages that speak our own types), then `adapter.InputAdapter`
(any other), `arrays` (complete arrays), `profiles` (parameter files).
"""

from msls_ros.inputs.adapter import EffectorRow, InputAdapter, StateRow, adapt
from msls_ros.inputs.arrays import Windowed, differentiated
from msls_ros.inputs.input_map import InputMap
from msls_ros.inputs.synchronizer import NamedVector, PairedSample, Refused, Synchronizer

__all__ = [
    "EffectorRow",
    "InputAdapter",
    "InputMap",
    "NamedVector",
    "PairedSample",
    "Refused",
    "StateRow",
    "Synchronizer",
    "Windowed",
    "adapt",
    "differentiated",
]
