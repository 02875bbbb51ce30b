"""Compiling the estimator before a command needs it: once on a machine, for minutes, and not in silence."""

from __future__ import annotations

import sys

from msls_ros.estimation.warm_up import is_kept, warm_up

DEFAULT = "bank"
"""Estimator of the shipped profiles."""


def compile_once(*methods: str) -> None:
    """Compile estimators that were not compiled on this machine yet, saying so on stderr; nothing where they were.

    Parameters
    ----------
    methods
        Of the estimators: bank, msls or rls.
    """
    for method in dict.fromkeys(methods):
        if is_kept(method):
            continue
        _say(f"compiling the estimator ({method}), once on this machine: one to three minutes ...")
        took = warm_up(method, lambda seconds: _say(f"compiling: {seconds:.0f} s"))
        _say(f"compiled in {took:.0f} s, kept for the next time")


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
