"""Which law flies, and why: what a law needs is there, or the next one that can do without.

=====================================  =================================================================
what is missing                        what flies
=====================================  =================================================================
a new model, or a finite one           the law that is asked for, on the last model that was believed
measured accelerations                 the same, on derivatives of the measured states
knowledge of an axis (no prior yet)    the stack's fixed law, or the last trim, with dither, until it is known
samples, for a while                   the last trim; then, with measured accelerations, the same law at once
both, samples and accelerations        the fixed law, or the last trim, until derivatives can be had again
a command to follow                    the same
a gain that stabilises (lq)            indi
=====================================  =================================================================
"""

from __future__ import annotations

from dataclasses import dataclass

FIXED, INDI, LQ, HOLD = "fixed", "indi", "lq", "hold"


@dataclass(frozen=True)
class Situation:
    """What there is to fly with."""

    asked: str
    """The parameter `law`."""
    regular: bool
    """Whether samples come as they should."""
    gap: float
    """The last gap between them [s]."""
    command: bool
    """Whether there is a command that can be followed."""
    fixed: bool
    """Whether the stack has a law of its own, whose command came with the sample."""
    accelerations: bool
    """Whether they are measured."""
    model_age: float
    """[s]; infinite: none came yet."""
    model_timeout: float
    """[s]"""
    frozen: bool
    """Whether no model is wanted."""
    unknown: tuple[str, ...]
    """Axes that no surface is known to move."""
    dropped: bool
    """Whether the measured response has just disproved the model."""
    lq_problem: str
    """Why there is no gain; empty: there is one."""


@dataclass(frozen=True)
class Choice:
    """The law that flies."""

    law: str
    reason: str


def choose(now: Situation) -> Choice:
    """Return the law that flies and why; see the module."""
    if now.asked == FIXED:
        return _without(now, "asked for")
    if not now.regular:
        return _without(now, f"samples were {now.gap:.2f} s apart")
    if not now.command:
        return _without(now, "there is no command that can be followed")
    if now.unknown:
        return _without(now, f"no surface is known yet to move {' and '.join(now.unknown)}")
    notes = []
    law = LQ if now.asked == LQ else INDI
    if law == LQ and now.lq_problem:
        law = INDI
        notes.append(f"lq: {now.lq_problem}")
    if not now.accelerations:
        notes.append("accelerations are derived from rates")
    if now.dropped:
        notes.append("the measured response disproved the model: the prior's")
    elif now.frozen:
        notes.append("the prior's model")
    elif not now.model_age <= now.model_timeout:
        notes.append(
            f"the last believed model: none for {now.model_age:.1f} s" if now.model_age < 1e9 else "no model yet"
        )
    return Choice(law, "; ".join(notes) or "on the identified model")


def _without(now: Situation, why: str) -> Choice:
    return Choice(FIXED, why) if now.fixed else Choice(HOLD, f"{why}; there is no fixed law: the last trim")
