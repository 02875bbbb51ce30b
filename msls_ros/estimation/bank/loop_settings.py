"""Settings of the compiled loop of the bank, `BankSettings`; `bank.settings` makes them of the parameters.

Inside the bank the constant stands first among the regressors.
"""

from __future__ import annotations

from typing import NamedTuple

from msls_ros.estimation.compiled import passed_by_reference
from msls_ros.estimation.kernel import Array, Integers


@passed_by_reference
class BankSettings(NamedTuple):
    """What the loop needs to know; p regressors, m members, w windows."""

    period: float
    """Of the samples [s]."""
    members: int
    """How many there are; arrays of m hold the last one again, with no share, to the end of a vector."""
    forgetting: Array
    """(m,) lambda of each member, per sample [1]."""
    held: Integers
    """(m,) 1 where forgetting goes with what is learnt."""
    axis: Integers
    """(m,) of which axis' outputs, where it does."""
    row_axis: Integers
    """(r,) axis of each row: 0 longitudinal, 1 lateral."""
    kind: Integers
    """(r,) of each row's sensors: 0 of moments, 1 of forces, see `bank.delay`."""
    counts: Integers
    """(r,) 1 where the energy of a row's output says that its axis is excited."""
    mixes: Array
    """(r, m) 1 where a member has a share in a row: the free ones, and those held by the row's axis."""
    drift: Array
    """(m,) kappa: walk of the constant per sample over the residual's standard deviation [1]."""
    prior: Array
    """(p, m) diagonal of a new factor, constant first [1/parameter, residual variance 1]."""
    sigma: Array
    """(p,) the bank's unit of each regressor, constant first; the constant's is 0."""
    wind_up: float
    """Share of the prior that comes back, row by row [1]."""
    judging: float
    """Forgetting factor of the evidence [1]."""
    delay: int
    """Samples between an estimate and the delayed prediction that it is judged by."""
    power: float
    """Power of the evidence of one-step and of delayed predictions [1]."""
    quiet: float
    """Least weight of a sample in the evidence [1]."""
    energy: Array
    """(4,) gains per sample: of the outputs' slow mean, their present energy, the energy remembered, its rise."""
    detect: bool
    windows: Integers
    """(w,) samples over which squared prediction errors are averaged, rising."""
    differenced: Integers
    """(r,) 1 of rows of angular rates: means of their prediction errors are looked at, see `bank.detection`."""
    mean_forgetting: float
    """Forgetting factor of what means of their prediction errors are usually [1]."""
    quantiles: Array
    """(p, w) by row: what such a mean of unit variance reaches once in 1e8 samples of Gaussian noise."""
    threshold: float
    floor: float
    """Share of the remembered energy that an alarm needs at least [1, rms]."""
    base: float
    """Forgetting factor of the nominal squared error [1]."""
    rest: int
    """Samples without detection at a start."""
    residual_forgetting: float
    colour_forgetting: float
    effectors_from: int
    """Index of the first effector among the regressors, the constant last."""
    effectors_to: int
    reference: Integers
    """(2,) member whose information counts as knowledge, by axis: the longest memory, the widest prior."""
    recent: int
    """Member whose information counts as excitation."""
    window: int
    """Samples in a block of those by which effects are held against the last seconds, see `bank.changes`."""
    learning: int
    """Samples for which no alarm is raised after a first excitation."""
    straddle: int
    """Samples after an alarm whose windows straddle the change: they do not enter the restarted rows."""
    servos: bool
    """Whether deflections are commands behind servos that were declared, see `bank.responses.shape_doubt`."""
    velocities: Integers
    """(v,) which regressors are velocities, constant first."""
    speed: Array
    """(v,) their scales."""
    scaled: bool
    """Whether effects go with airspeed, see `bank.speed`."""
    exponent: Integers
    """(p,) with which power of it, constant first."""
    place: float
    """Gain per sample of their means."""
    axial: int
    """Row of the axial velocity u, in which surfaces make drag, see `bank.drag`; negative: none."""
    rates: Integers
    """(w,) which regressors are the angular rates about the body's axes, constant first; all three or none."""
    coupled: Integers
    """(p, p) which of them, times a regressor, the equation of another one holds: see `inertial_square`; or -1."""
    turning: Integers
    """(p, p) by row's own regressor: which regressor, times ``turned``, is the part of the derivative by a regressor
    that is known and not in the estimates, for the body's axes turn; 0: none. See `kinematics.remove_rotation`."""
    turned: Array
    quick: float
    """Gain per sample of the mean above which regressors are quick, see `bank.lags`."""
    third: float
    """Of third differences, to be of the size of the noise in what they are of, see `bank.effector_noise`."""
    second: float
    """The same of second differences."""
    rest_block: int
    """Samples of which it is asked whether an output has answered an effector, see `bank.effector_noise`."""
    white_spread: float
    """By what the variance of a sum of products of these and outputs is larger than that of independent ones [1]."""
    rest_spread: float
    """The same of products of what has passed a window itself, and outputs [1]."""
    answered: float
    """Squared standard errors by which an output may go with them by chance, at all delays together [1]."""
    entry: float
    """Share that a sample forgets of how outputs go with the noise in the states, see `bank.effector_noise`."""
    slope_noise: float
    """Variance of white noise in a state that has passed the window over what it leaves of the derivative [s^2]."""
    late: int
    """Samples by which responses may be late, see `bank.lags`."""
    lags: Array
    """(l, 3) lags of actuators, none first: weights of last output, last input and input; see `bank.responses`."""
    lag_times: Array
    """(l,) time constants of these [s]."""
    responses: Integers
    """(a, 2) which lag, and blocks back, of the responses that are held against each other, that of a start first; the
    last ones, one for each lag but none, are its filter without its delay."""
    pairs: Integers
    """(i, 2) the pairs of lag, and blocks back (of those ahead), that these are made of."""
    paired: Integers
    """(a, 2) which of them each is made of: that of its delay, and that of a block more."""
    ahead: int
    """Blocks that those look into the future at most."""
    block_forgetting: float
    """Forgetting factor of their sums, and gain (``block_quick``) of the mean above which they are quick, by block."""
    block_quick: float
    latest: int
    """Samples by which deflections are taken back at most."""
    late_noise: float
    """1 - r of the autocorrelation r of white noise that has passed the window, ``late`` samples on [1]."""
    late_part: float
    """Part of an effect that may come that late before anything is known of it, standard deviation [1]."""
    late_apart: float
    """By how much the delays of forces and of moments differ, over l, standard deviation [1]."""
    gains: Array
    """(k, m) position of each surface by each effector, as shares its effect by theirs; see `surfaces`."""
    shares: Array
    loss_members: Integers
    """(a,) members whose estimates are compared with older ones, see `bank.losses`."""
    loss_delays: Integers
    """(a,) by how much older, in strides."""
    ramp_lengths: Integers
    """(h,) after so many samples moments that an alarm has begun with stay what they are, see `bank.ramps`."""
    loss_tests: Integers
    """(a,) how many times in a row each must see a loss."""
    loss_sums: int
    """How many lengths of sums of innovations are looked at, see `bank.loss_noise`, and of which member."""
    noise_member: int
    loss_limits: Array
    """(a, 2) by how many standard errors, so many times, and half as many [1]."""
    stride: int
    """Samples between estimates that are kept for that."""
    persistence: int
    """Samples of which regressors and outputs are kept, for the mean that an effect is changed about."""
    feedback_lags: Integers
    """(l,) samples between a residual and the regressors that may answer it, see `bank.feedback`."""
    batches: Integers
    """(k,) samples of the batches of which the estimates' moves are taken, see `bank.batches`."""
    batch_factor: Array
    """(k,) by what the variance of so few of them is larger [1]."""
    followed_row: int
    followed_column: int
    """Of the estimate that `Output.followed` holds; negative: none."""
