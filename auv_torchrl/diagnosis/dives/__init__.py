"""Many dives of one vehicle: each told by its numbers, then what changed, when, and how sure that is."""
