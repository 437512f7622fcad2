"""Watching a vehicle: dives over time, and repeated runs of one manoeuvre. Built on the parts of the diagnosis.

Read the modules in this order. Dives over time:

1. ``dive_record``: the parameters that are tracked, the reference dives, and what one further dive tells.
2. ``shifts``: steps and drifts of a series of numbers, and the threshold that one false alarm in so many dives needs.
3. ``changes``: series of all parameters over the dives, alarms as they would have been raised, changes seen at the end.
4. ``dive_history``: the content of ``dives.json``, and its sentences.
5. ``dive_page``: ``dives.html``.
6. ``dive_work``: following dives in parallel, with a store from which a killed run goes on.
7. ``dive_job``: which logs are dives, and what the command does with them; ``dive_date`` reads dates off their names.

Repeated runs of one manoeuvre:

1. ``runs``: runs as tables of equal size, their spectra, and how each begins.
2. ``healthy_runs``: the distribution of healthy runs.
3. ``vibration``: a line in the spectrum of a gyro that no healthy run has.
4. ``run_sensitivities``: what every candidate would change in each run.
5. ``run_evidence``: probabilities of the effects in one run, or in several.
6. ``repeated_runs``: from logs to the report, ``alike.json`` and the console.

``command`` is the command line of ``diagnose.py``, which also diagnoses a single log (:mod:`auv_torchrl.diagnosis`).
"""
