"""Real-time identification of an aircraft's linear model (Ward, Barron, Carley and Curtis: MSLS, detection, ANI)."""
