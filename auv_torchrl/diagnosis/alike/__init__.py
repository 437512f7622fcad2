"""Short runs of one manoeuvre, flown again and again: each is held against what sound runs look like."""
