"""Where the gap lies: axis, origin, thruster, regime and time. Read ``attribute``, then ``locate``."""
