"""Figures and the page of a flight, from plain data: the caller has computed what is shown.

This room imports matplotlib and no other room. Begin with `recorded.Recorded` (what can be shown), then
`flight_report.make_report` (the page) and `flight_figures` (the demo's pictures).
"""
