"""Flights of a simulated aircraft without ROS: scenarios as data, the closed loop, and how a flight is judged.

This room imports `plant`, `inputs` (for the profiles that scenarios name) and `estimation`. Begin with
`scenarios.Scenario` (what is flown), then `closed_loop.fly` (a sample at a time), `judging` and `comparison` (errors
against truth, delays, false alarms).
"""
