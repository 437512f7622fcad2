"""Logs of every format that a reader takes, made and damaged by hypothesis, and what reading one may come to.

One file a format makes logs; ``values`` has what a field may hold, ``damage`` what happens to bytes and records, and
``contract`` reads a log and checks what comes of it. ``python -m tests.flightlog.fuzz --draws 5000`` reads many.
"""
