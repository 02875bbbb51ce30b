"""The engine of an identifier by the configured method: MSLS and RLS (`Regression`), or the bank (`BankRegression`)."""

from __future__ import annotations

from msls_ros.estimation.bank.regression import BankRegression
from msls_ros.estimation.bank.settings import bank_settings
from msls_ros.estimation.configuration import Configuration
from msls_ros.estimation.regression import Regression
from msls_ros.estimation.settings import loop_settings

Engine = Regression | BankRegression


def make_engine(c: Configuration, straddle: int = 0, *, servos: bool = False) -> Engine:
    """Return the engine that a configuration asks for.

    Parameters
    ----------
    c
        All parameters.
    straddle
        Samples over which the inputs were smoothed; 0: they were not.
    servos
        Whether deflections are commands behind servos that were declared.
    """
    if c.estimator.method == "bank":
        return BankRegression(bank_settings(c, straddle, servos=servos), len(c.rows))
    return Regression(loop_settings(c), len(c.rows))
