"""Active noise injection (ANI, eqs 20-23): small random effector activity that keeps B identifiable.

`injection` is its face to the identifier; `law` answers one sample after the other, with the rms of `rms`, the limits
of `limits`, the window of `window` and the start of `onset`. It knows of no estimator: B-hat and its variances are
given.
"""

from msls_ros.estimation.dither.injection import DitherLaw

__all__ = ["DitherLaw"]
