"""The measured motion of a vehicle in short windows of a log, and what every change of the vehicle would do to it.

Read the modules in this order:

- ``windows``: samples of a log in short windows on a uniform time grid, and how many windows fit the memory.
- ``cut``: a log is cut into such windows.
- ``actuation``: the thrust that vehicles make of the logged commands, before any motion.
- ``rollout``: many vehicles simulated over many windows, and what their sensors report at the times of the samples.
- ``tangent``: the rollout linearised along every window, and the slopes in starts and forces that come from it.
- ``smooth``: a rough missing force, then starts and forces under which every window follows its samples.
- ``noise``: white noise of each channel, and what whitens errors that are not white.
- ``force``: the force that a changed vehicle would have added along the measured motion, and its response.
- ``reduce``: starts and disturbances integrated out of all windows, which leaves one small quadratic.
"""
