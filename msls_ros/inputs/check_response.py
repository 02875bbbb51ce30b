"""How long after a surface the aircraft answers, and whether measured derivatives belong to their states."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from msls_ros.estimation import Configuration
from msls_ros.estimation.kernel import Array
from msls_ros.inputs.check_effectors import effectors_of
from msls_ros.inputs.check_motion import wind_of
from msls_ros.inputs.findings import DOUBTFUL, NOTE, WRONG, Finding, delay_words
from msls_ros.inputs.frames import BODY
from msls_ros.inputs.input_map import AIR_DATA, WIND
from msls_ros.inputs.motion import Motion, Reading
from msls_ros.inputs.own_delays import OwnDelay, own_delays, shifted
from msls_ros.inputs.response import Following, Response, Search
from msls_ros.inputs.series import Record, Series, on_grid
from msls_ros.inputs.servo_lag import followed
from msls_ros.inputs.windows import beyond_noise, misfit, noise_of, windowed

_STEP = 0.01
_WORTH = 0.02
"""Delay worth naming [s]."""
_MOST = 20000
_GAIN, _LEAST = 0.08, 0.005
"""Share of the residual, and of the angular accelerations, that the delay must explain."""
_FOUND = (-0.05, 0.06)
"""Delays between which the bank finds them itself, and takes them back [s]."""
_SURE = 0.5
"""Share from which it is sure: a law that answers a fault nobody measures gave 0.38, real delays give 0.65 and more."""
_TAKEN_BACK, _PLAINLY = 0.02, 0.03
"""Delay that a servo's lag takes back [s], and share of the angular accelerations that it explains beyond the delay,
from which a map's delay is said to stand for a lag. Measured: .04 s and .35 of a lag of 60 ms."""
_WHERE = "inputs.effectors"
_NO_VELOCITY = "whether the aircraft answers the surfaces when the map says is not seen without its velocity"
_MEANT = {"de": 1, "elevator": 1, "da": 0, "aileron": 0, "ailerons": 0, "dr": 2, "rudder": 2}
"""Axis that a surface of this name turns the aircraft about: roll, pitch, yaw."""
_OTHER = 6.0
"""It turns it about another so many times as much, for the names to be exchanged."""
_YAWS, _CROSSED = 1.2, 5.0
"""Yaw by an "aileron" over its roll, and that times roll by the "rudder" over its yaw, from which they are exchanged.
The second alone, in which units and inertia cancel, is 4.6 of an Aerosonde, whose rudder rolls and whose aileron yaws;
the first is .4 there."""
_MOST_POWER = 1000.0
"""Angular acceleration per deflection beyond that of any aircraft [rad/s^2 per rad]."""
_UNRELATED, _TURNS = 1.4, 0.1
"""Misfit from which a derivative is none of its rate's, where that changes by so much over 0.4 s [rad/s^2, rms]."""
_FACTORS = {"-1": -1.0, "0.0174533": np.pi / 180.0, "57.2958": 180.0 / np.pi, "9.80665": 9.80665, "0.101972": 0.101972}


def check_response(record: Record, configuration: Configuration) -> Iterator[Finding]:
    """Yield the delay from the surfaces to the angular accelerations, or that none stands out.

    That the aircraft answers as the map says is said only where surfaces at that delay leave plainly less unexplained
    than at others up to 3 s: states and a law that feeds them back explain much of a flight whatever the surfaces are.

    Parameters
    ----------
    record
        What was read of the log.
    configuration
        Of the identifier: the bank finds such delays itself, up to `_FOUND`, the paper's method none.
    """
    response = _response(record)
    if response is None:
        return
    scores = response.scores()
    best, none = int(np.argmin(scores)), len(scores) // 2
    far = response.search().beyond(response, float(scores[best]), at_end=best in (0, len(scores) - 1))
    if far is not None:
        yield _far(record, response, far)
        return
    mended, own = _mended(response, best - none)
    yield from _own(record, response, own)
    but = ", ".join(response.names[one.index] for one in own)
    for found in _together(record, mended, configuration):
        if not own or found.kind not in ("delay", "servo_lag"):
            yield found
        elif found.level != NOTE:
            yield replace(found, what=f"but for {but}, {found.what}")


def _together(record: Record, response: Response, configuration: Configuration) -> Iterator[Finding]:
    """Yield what is said of surfaces that have one delay, of at most `Response.most` steps."""
    scores = response.scores()
    best, none = int(np.argmin(scores)), len(scores) // 2
    search = response.search()
    lag = (best - none) * response.step
    explained = scores[none] - max(scores[best], 0.0)
    gain = explained / scores[none] if explained > _LEAST else 0.0
    if response.turn.shape[1] == 3 and scores[best] < 0.5:
        effects = response.effects(best - none)
        yield from _names(response.names, *effects, response.delta.std(axis=0))
        yield from _exchanged(response.names, *effects)
    if scores[best] > 0.9:
        yield Finding(NOTE, "response", _WHERE, "the surfaces explain less than a tenth of the angular accelerations")
    elif not search.shows(float(scores[best]), lag):
        yield _unseen(search, float(scores[best]))
    elif gain < _GAIN or abs(lag) < max(_WORTH, response.step):
        stands = _taken_for_delay(record, response, best - none, float(scores[best]))
        agrees = f"the aircraft answers the surfaces as the map says, within {_WORTH:g} s"
        yield stands or Finding(NOTE, "delay", _WHERE, agrees)
    elif not response.moves:
        yield Finding(NOTE, "delay", _WHERE, _NO_VELOCITY)
    else:
        bank = configuration.estimator.method == "bank"
        yield _delay(record, response, best - none, float(scores[best]), gain=gain, bank=bank)


def _mended(response: Response, common: int) -> tuple[Response, list[OwnDelay]]:
    """Return the surfaces at one delay, and those that have another; none, where then still no delay stands out."""
    own = own_delays(response, common) if response.moves else []
    mended = shifted(response, own)
    scores = mended.scores()
    best = int(np.argmin(scores))
    if own and mended.search().shows(float(scores[best]), (best - len(scores) // 2) * response.step):
        return mended, own
    return response, []


def _own(record: Record, response: Response, own: list[OwnDelay]) -> Iterator[Finding]:
    """Yield what is said of surfaces whose delay is not that of the others, where it is not what the map says."""
    streams = {n: s.stream for n, s in effectors_of(record).items()}
    for one in own:
        name, lag, apart = response.names[one.index], one.steps * response.step, one.steps - one.others
        if abs(lag) < _WORTH:
            continue
        stream = streams[name]
        alone = sum(s.source == stream.source for s in streams.values()) == 1
        side, word = "early" if apart > 0 else "late", "after" if lag > 0.0 else "before"
        what = f"stamped {1e3 * abs(apart) * response.step:.0f} ms too {side} against the other surfaces: the aircraft "
        what += f"answers it {1e3 * abs(lag):.0f} ms {word} it moves as mapped; B is wrong by it"
        mend = delay_words(-lag, 1e-9 * stream.delay, "its topic's line" if alone else "its own line")
        if apart > 0:
            mend += "; or servo= there, where it is a command that a servo slower than the others' follows"
        yield Finding(DOUBTFUL, "delay", f"{_WHERE}.{name}", what, mend)


def _delay(record: Record, response: Response, steps: int, left: float, *, gain: float, bank: bool) -> Finding:
    """Return what is said of a delay of so many steps that leaves a share: a servo's lag, or none."""
    lag = steps * response.step
    own = bank and _FOUND[0] < lag < _FOUND[1]
    what, mend = _answers(record, lag)
    if any(s.stream.servo > 0.0 for s in effectors_of(record).values()):
        mend += "; or another servo= there"
    elif stands := _taken_for_delay(record, response, steps, left):
        return stands
    elif lag > 0.0 and (servo := response.following(steps)).left < left:
        return _servo(record, what, servo, bank=bank)
    if own:
        so = "the identifier looks for as much in flight (model.delay), B may be wrong until it has found it"
        mend = f"measured deflections, or the true delay in the map, are better: {mend}"
        return Finding(DOUBTFUL, "delay", _WHERE, what + so, mend)
    return Finding(WRONG if gain > _SURE else DOUBTFUL, "delay", _WHERE, f"{what}B is wrong by it", mend)


def _servo(record: Record, what: str, servo: Following, *, bank: bool) -> Finding:
    """Return what is said of surfaces that are commands, which servos follow."""
    now = _delay_of(record)
    near = abs(servo.delay) < _WORTH
    later = "" if near else f", {_later(servo.delay)} than the map says"
    what += f"they are commands, which servos follow, with a lag of about {1e3 * servo.lag:.0f} ms{later}"
    delay = "leave delay= as it is"
    if now is not None and not near:
        delay = f"write delay={round(now - servo.delay, 2) + 0.0:.2f} for the rest"
    mend = "map measured deflections. Where there are none"
    mend += f", {delay}: the identifier finds a servo's lag itself; a" if bank else ", a"
    mend += f" servo that is known goes into the topic's line: {_line(servo, now)}"
    return Finding(DOUBTFUL, "servo_lag", _WHERE, what, mend)


def _taken_for_delay(record: Record, response: Response, steps: int, left: float) -> Finding | None:
    """Return that the map's delay stands for a servo's lag; None: nothing is seen of that."""
    now = _delay_of(record)
    if now is None or now > -_TAKEN_BACK or any(s.stream.servo > 0.0 for s in effectors_of(record).values()):
        return None
    servo = response.following(steps)
    if servo.left > left - _PLAINLY or servo.delay > -_TAKEN_BACK:
        return None
    what = f"delay={now:.3f} stands for a servo's lag, which fits better: one of about {1e3 * servo.lag:.0f} ms, "
    what += f"{_later(servo.delay)} than the map says; B is wrong by it, and its bars do not say so"
    less = f"take it down to about {round(now - servo.delay, 2) + 0.0:.2f}: the identifier finds a servo's lag itself"
    mend = f"{less}; where the servo is known, write {_line(servo, now)} in the topic's line"
    return Finding(DOUBTFUL, "delay", _WHERE, what, mend)


def _later(delay: float) -> str:
    """Return by how much a delay [s] is later or earlier."""
    return f"{1e3 * abs(delay):.0f} ms {'later' if delay > 0.0 else 'earlier'}"


def _line(servo: Following, now: float | None) -> str:
    """Return the words of a topic's line, in which the map has a delay of now [s], for a servo."""
    delay = "" if now is None else f" delay={round(now - servo.delay, 3) + 0.0:.3f}"
    return f"servo={servo.lag:g}{delay}"


def _answers(record: Record, lag: float) -> tuple[str, str]:
    """Return what is said of a delay [s], and what to write."""
    word = "after" if lag > 0.0 else "before"
    what = f"the aircraft answers {1e3 * abs(lag):.0f} ms {word} the surfaces as mapped: "
    return what, delay_words(-lag, _delay_of(record), "the topic's line")


def _far(record: Record, response: Response, steps: int) -> Finding:
    """Return what is said of a delay of so many steps that no servo makes."""
    if not response.moves:
        return Finding(NOTE, "delay", _WHERE, _NO_VELOCITY)
    what, mend = _answers(record, steps * response.step)
    return Finding(WRONG, "delay", _WHERE, f"{what}servos and links take less, their stamps are of another clock", mend)


def _unseen(search: Search, left: float) -> Finding:
    """Return that no delay stands out, of which the best near one leaves so much."""
    what = f"no delay within {search.farthest:.2g} s stands out, at which the aircraft answers these surfaces: the "
    what += f"best leaves {left / search.typical:.0%} of the angular accelerations that an arbitrary one leaves"
    mend = "check stamps, clock and unit of their topic, and that it is of this aircraft; or fly larger inputs"
    return Finding(DOUBTFUL, "response", _WHERE, what, mend)


def _delay_of(record: Record) -> float | None:
    """Return the delay that the map gives all surfaces in the lines of their topics [s]; None: they differ."""
    delays = {s.stream.delay for s in effectors_of(record).values()}
    delays |= {record.inputs.topics[s.stream.source].delay for s in effectors_of(record).values()}
    return 1e-9 * delays.pop() if len(delays) == 1 else None


def _velocities(record: Record) -> dict[str, Series]:
    """Return the streams of a record that hold the velocity, those over ground turned into the aircraft's axes.

    Returns
    -------
    dict
        By name; empty where there are none, or the attitude that they need is not mapped.
    """
    series = record.series
    if "velocity" not in series:
        parts = [n for n in ("states.u", "states.v", "states.w") if n in series]
        return {n: series[n] for n in parts or AIR_DATA if n in series}
    own = series["velocity"]
    if own.stream.earth is None and WIND not in series:
        return {"velocity": own}
    names = ("attitude",) if "attitude" in series else ("states.Phi", "states.Theta", "states.Psi")
    if not all(n in series for n in names):
        return {} if own.stream.earth else {"velocity": own}
    attitude = [np.interp(own.time, series[n].time, column) for n in names for column in series[n].values.T]
    quaternion, euler = (np.stack(attitude, axis=1) if len(names) == count else None for count in (1, 3))
    stream = series[names[0]].stream
    reading = Reading(
        attitude_body=stream.body if len(names) == 1 else "frd",
        attitude_earth=stream.earth if len(names) == 1 else "ned",
        velocity_frame=own.stream.earth or own.stream.body or "frd",
    )
    motion = Motion(_STEP, quaternion, euler, velocity=own.values, wind=wind_of(record, own.time))
    values = motion.air_velocity(reading)
    return {} if values is None else {"velocity": replace(own, values=values)}


def _response(record: Record) -> Response | None:
    """Return what the delay is looked for in; None: rates or moving surfaces are not there, or share no second."""
    rates = [n for n in ("angular_velocity", "states.P", "states.Q", "states.R") if n in record.series]
    surfaces = {n: s for n, s in effectors_of(record).items() if np.ptp(s.values) > 0.0 and not s.stream.track.held}
    if not rates or not surfaces:
        return None
    moves = _velocities(record)
    chosen: dict[str, Series] = {n: record.series[n] for n in rates}
    chosen.update(moves)
    chosen.update((f"effectors.{n}", s) for n, s in surfaces.items())
    if any(len(s.stamps) < 50 for s in chosen.values()):
        return None
    periods = [float(np.median(np.diff(s.stamps))) * 1e-9 for s in chosen.values()]
    grid = on_grid(chosen, max(_STEP, 0.25 * max(periods)), _MOST)
    if grid is None:
        return None
    turn, delta = (
        np.concatenate([grid[1][n] for n in names], axis=1) for names in (rates, [f"effectors.{n}" for n in surfaces])
    )
    signs = np.array(BODY[chosen[rates[0]].stream.body or "frd"]) if turn.shape[1] == 3 and len(rates) == 1 else 1.0
    noise = np.concatenate([period * noise_of(s.values) for period, s in zip(periods, chosen.values(), strict=True)])
    step = float(grid[0][1])
    first = max(int(s.stamps[0]) for s in chosen.values())

    def behind(lag: float) -> Array:
        columns = (followed(s.stamps, s.values[:, 0], lag, s.stream.track.age) for s in surfaces.values())
        times = ((s.stamps - first) * 1e-9 for s in surfaces.values())
        return np.stack([np.interp(grid[0], t, y) for t, y in zip(times, columns, strict=True)], axis=1)

    return Response(step, list(surfaces), turn * signs, [grid[1][n] for n in moves], delta, noise, behind)


def _names(names: list[str], effects: Array, left: Array, moved: Array) -> Iterator[Finding]:
    """Yield surfaces that turn the aircraft about another axis than one of their name does, or more than any can."""
    for name, effect, rms in zip(names, effects, moved, strict=True):
        power = float(effect.max() / rms)
        if power > _MOST_POWER and effect.max() > 2.0 * left[int(np.argmax(effect))]:
            what = f"would turn the aircraft by {power:.0f} rad/s^2 per rad: it moves further than the map says"
            mend = "a larger scale: 57.3 times, where radians were taken for degrees"
            yield Finding(WRONG, "units", f"inputs.effectors.{name}", what, mend)
        meant = _MEANT.get(name.lower())
        if meant is None:
            continue
        most = int(np.argmax(effect))
        about = {0: "roll", 1: "pitch", 2: "yaw"}
        rivals = {1} if meant != 1 else {0, 2}  # ailerons yaw, and rudders roll, the aircraft as well
        if most in rivals and effect[most] > _OTHER * effect[meant] and effect[most] > 2.0 * left[most]:
            what = f"turns the aircraft in {about[most]}, hardly in {about[meant]}: the channel of another surface?"
            mend = f"map the one that drives {name}; where this is it, give it another name"
            yield Finding(WRONG, "names", f"inputs.effectors.{name}", what, mend)


def _exchanged(names: list[str], effects: Array, left: Array) -> Iterator[Finding]:
    """Yield that the surfaces for roll and yaw are exchanged, where each does plainly what the other is named for.

    Effects (m, 3) and what is left (3,) are as `Response.effects` gives them.
    """
    about = {axis: [k for k, n in enumerate(names) if _MEANT.get(n.lower()) == axis] for axis in (0, 2)}
    if any(len(found) != 1 for found in about.values()):
        return
    (rolls,), (yaws,) = about[0], about[2]
    aileron, rudder = effects[rolls], effects[yaws]
    clear = aileron[2] > max(left[2], _YAWS * aileron[0]) and rudder[0] > left[0]
    if clear and aileron[2] * rudder[0] > _CROSSED * aileron[0] * rudder[2]:
        what = f"by {names[rolls]} the aircraft yaws, and by {names[yaws]} it rolls, more than the other way round: "
        what += "the two are exchanged"
        where = f"inputs.effectors.{names[rolls]}, {names[yaws]}"
        yield Finding(WRONG, "names", where, what, "exchange their channels, or give them other names")


def check_derivatives(record: Record) -> Iterator[Finding]:
    """Yield measured derivatives that are not those of their states, with the factor that makes them so."""
    pairs = [
        (name, f"states.{name.removeprefix('derivatives.')}")
        for name in record.series
        if name.startswith("derivatives.")
    ]
    if "angular_acceleration" in record.series:
        pairs.append(("angular_acceleration", "angular_velocity"))
    for derivative, state in pairs:
        if state in record.series and min(len(record.series[n].stamps) for n in (derivative, state)) > 50:
            yield from _check_derivative(record, derivative, state)


def _check_derivative(record: Record, derivative: str, state: str) -> Iterator[Finding]:
    pair = {n: record.series[n] for n in (derivative, state)}
    slowest = max(float(np.median(np.diff(s.stamps))) * 1e-9 for s in pair.values())
    grid = on_grid(pair, max(_STEP, slowest), _MOST)
    if grid is None:
        return
    step = float(grid[0][1])
    signs = [np.array(BODY[pair[n].stream.body or "frd"]) if pair[n].values.shape[1] == 3 else np.ones(1) for n in pair]
    given, values = (grid[1][n] * s for n, s in zip((derivative, state), signs, strict=True))
    sides, misfits = [], []
    for window in (0.1, 0.4):
        width = max(1, round(window / step))
        slope = (values[width:] - values[:-width]) / (width * step)
        measured = windowed(given, width)
        sides.append((slope - slope.mean(axis=0), measured - measured.mean(axis=0)))
        ends = 2.0 * noise_of(pair[state].values) / (width * step) ** 2
        share = min(1.0, float(np.median(np.diff(pair[derivative].stamps))) * 1e-9 / (width * step))
        found = beyond_noise(*sides[-1], (ends, share * noise_of(pair[derivative].values)))
        misfits.append(0.0 if found is None else found[0])  # where noise hides it nothing is said of it
    now, long = misfits
    slope, measured = sides[0]
    if now < 0.8 or slope.std() < 1e-6:
        return
    where, leaf = f"inputs.{derivative}", state.rpartition(".")[2]
    what = f"is not the derivative of {leaf} (misfit {now:.2g}; 0 agrees, 2 unrelated, 4 opposite)"
    for word, factor in _FACTORS.items():
        if misfit(slope, factor * measured) < min(0.4, 0.4 * now):
            yield Finding(WRONG, "derivative", where, what, f"scale={word}")
            return
    if slope.shape[1] == 3 and misfit(slope, measured * BODY["flu"]) < 0.4:
        yield Finding(WRONG, "derivative", where, what, "the other frame, flu or frd")
        return
    unrelated = leaf in (*"PQR", "angular_velocity") and float(sides[1][0].std()) > _TURNS
    level = WRONG if unrelated and min(now, long) > _UNRELATED else DOUBTFUL
    yield Finding(level, "derivative", where, what, "map what is; or leave it out, so that the state is differentiated")
