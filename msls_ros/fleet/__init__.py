"""Many runs side by side: in this process, on several cores of this machine, or on a Dask cluster."""
