"""From bag to bag: recorded messages through the gate and the identifier of the flight, and the data of the report.

This room imports `bags`, `inputs` and `estimation`, `flights` to judge recorded flights that hold their truth, and
the plain data of `report`. Begin with `identification` (a log, messages or arrays to models as arrays: for pytest and
notebooks) or `replay.replay` (a bag of any length into a new one), then `sources` (bag to samples), `outputs`
(estimates to messages), `report_data` (a bag to what the page shows).
"""
