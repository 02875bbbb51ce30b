"""Real-time identification of an aircraft's linear model (Ward, Barron, Carley and Curtis: MSLS, detection, ANI).

Begin with `offline.identification` (recordings, messages or arrays through a map, to models as arrays; no ROS needed),
`estimation.Identifier` (complete samples), or `testing.Bench` (nodes in pytest).
"""
