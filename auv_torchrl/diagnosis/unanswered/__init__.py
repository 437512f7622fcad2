"""Channels of a log that do not follow the vehicle: a stuck gauge, a frozen source, a vehicle that is held.

Read the modules in this order:

1. ``stillness``: the stretches in which a channel stands still while the commands would have moved it.
2. ``weigh``: whether the vehicle or the sensor stands still, by what all other channels say, and the log without it.
3. ``other_source``: channels that move, but not with the vehicle, where nothing explains a log.
4. ``wording``: the sentences about it.
"""
