"""What other estimators cost and stand, measured side by side with ours in one run: ``./msls benchmark``."""
