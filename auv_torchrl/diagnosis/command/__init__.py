"""The commands ``auv-diagnose`` of one log and ``auv-calibrate``: from the command line to the files that are written.

Read the modules in this order:

1. ``schema``: types of what both commands are given.
2. ``logs``: logs, vehicle and mapping are read.
3. ``request``: all that a diagnosis needs, checked.
4. ``diagnose_job``: what ``auv-diagnose`` does.
5. ``calibrate_job`` and ``calibrate``: what ``auv-calibrate`` does, and how it is called.
"""
