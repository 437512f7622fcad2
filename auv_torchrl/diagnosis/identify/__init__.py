"""Which effects explain the gap: all of them weighed, the likeliest simulated and fitted."""
