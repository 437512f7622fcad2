"""What answers are worth: one answer against one truth, all of them together, and the tables and pictures of that.

Read ``judge`` first, then ``score``.
"""
