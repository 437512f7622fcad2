"""The sealed benchmark of the diagnosis: fly cases, seal the truth, diagnose, open the labels, score.

Flying shares with the diagnosis only what defines a vehicle (:mod:`auv_torchrl.physics`, :mod:`auv_torchrl.effects`);
half of the cases come from :mod:`benchmarks.blind.flights.foreign`, which does not even share that.
"""
