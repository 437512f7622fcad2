"""What is asked of a log once it is read: units, frames, clocks, and whether its columns tell of a motion at all.

Each module is one question; :mod:`auv_torchrl.flightlog.reader` asks them in order.
"""
