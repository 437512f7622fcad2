"""Where the gap lies: axis, origin, thruster, regime and time.

Read the modules in this order:

1. ``attribute``: how much of the gap each degree of freedom, origin and thruster has.
2. ``moments``: a thruster that pushes otherwise than commanded from moment to moment.
3. ``unlike``: such a thruster, or one with a map of its own, as a hypothesis beside effects.
4. ``wording``: what it was seen to do.
5. ``locate``: all of it for one log.
"""
