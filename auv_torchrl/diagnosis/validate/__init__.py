"""Held-out flight predicted without and with the effects that were found.

Read ``predict`` (predictions, their spread, and the errors of them), ``veto`` (what held-out flight takes back),
``confirm`` (the same flight in MuJoCo) and ``healthy_flights`` (which flights may serve as healthy ones).
"""
