"""A page in the browser: drop dives on it, see what they hold, and diagnose them. ``auv-page`` serves it.

Read the modules in this order:

1. ``store``: what the page remembers of dives and of jobs, in SQLite, and where their files lie.
2. ``upload``: a request that brings logs, streamed to disk within bounds, and the names that they get there.
3. ``recognise``: the process that reads one log and writes what is in it; ``proposal`` says which vehicle it may be.
4. ``overview``: curves of a dive over time, thinned for the browser.
5. ``jobs``: the command line of each kind of job; ``child`` is the process that runs it.
6. ``worker``: reads logs and runs jobs one by one; jobs that were running when the page ended run again.
7. ``guard``: which requests are answered, and what a browser may do with an answer.
8. ``rest`` and ``screens``: the interface for programs, and the pages for people; both are thin.
9. ``app`` puts them together; ``command`` is the command line.

An upload is read and never run, and never leaves its folder. A report is shown without the right to run scripts.
"""
