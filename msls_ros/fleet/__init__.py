"""Many runs side by side: in this process, on several cores of this machine, or on a Dask cluster.

This room imports dask, only when more than one process is asked for, and no other room. Begin with `runner.run`.
"""

from msls_ros.fleet.runner import run
from msls_ros.fleet.work import Done, FleetError

__all__ = ["Done", "FleetError", "run"]
