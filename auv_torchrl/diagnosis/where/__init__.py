"""Where the gap lies."""
