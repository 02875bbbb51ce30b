"""Many flights: what is flown with which seeds, one flight judged, kept in a folder, summarised in a table.

This room imports `flights` and `fleet`. Begin with `plan.plan` (scenarios, noises and settings to cells), then
`flight.fly_task` (one flight as plain data), `store` and `table`.
"""
