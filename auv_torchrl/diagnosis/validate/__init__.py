"""Held-out flight predicted without and with the effects that were found.

Read ``predict`` (predictions, their spread, and the errors of them), ``veto`` (what held-out flight takes back) and
``confirm`` (the same flight in MuJoCo), in this order.
"""
