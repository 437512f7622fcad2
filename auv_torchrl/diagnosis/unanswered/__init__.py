"""Channels of a log that do not follow the vehicle: a stuck gauge, a frozen source, a vehicle that is held.

Read the modules in this order:

1. ``stillness``: the stretches in which a channel stands still while the commands would have moved it.
2. ``held``: the stretches in which all of them stand still, and the log beside these.
3. ``weigh``: whether the vehicle or the sensor stands still, by what all other channels say, and the log without it.
4. ``other_source``: channels that move, but not with the vehicle, where nothing explains a log.
5. ``both_readings``: the diagnosis of such a log.
6. ``wording``: the sentences about it.
"""
