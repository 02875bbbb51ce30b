"""Real-time identification of an aircraft's linear model (Ward, Barron, Carley, Curtis: MSLS, change detection, ANI)."""
