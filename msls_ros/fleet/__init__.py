"""Many runs side by side: in this process, on several cores of this machine, or on a Dask cluster."""

from msls_ros.fleet.runner import Done, FleetError, run

__all__ = ["Done", "FleetError", "run"]
