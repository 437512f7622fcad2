"""How far the gap shrinks in held-out flight, and what that vetoes."""
