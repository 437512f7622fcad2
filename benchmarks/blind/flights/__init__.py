"""What is flown: cases and their sizes, simulators and pilots that the diagnosis does not know, damages of logs.

Read ``cases`` first, then ``fly``.
"""
