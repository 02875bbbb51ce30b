"""The paper reproduced: its linear experiments, its F-16 flights, its figures and its claims, each with bounds.

This room imports `flights` and `report`, and the `estimation` that is judged. Begin with `linear_experiments` (eqs
15-17, Figs 1-6) and `flight_experiments` (Figs 7-9); `claims` and `flight_claims` hold what the paper says against what
was measured.
"""
