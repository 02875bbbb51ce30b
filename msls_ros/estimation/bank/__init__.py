"""The bank of memories: the default estimator, and how it alarms, names and states its errors.

`regression` is its face to the identifier; `rows` is what a sample does to rows that share a history, and calls
`members` (factors), `mixing` (whose prediction counts), `detection` and `losses` (alarms and names) and `uncertainty`
(error bars). State, settings and scratch are in `state`, `loop_settings` and `work`. Equations: docs/method_bank.md.
It knows nothing of the dither, nor of the paper's estimator.
"""
