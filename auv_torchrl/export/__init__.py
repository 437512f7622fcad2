"""What leaves the simulator: a policy and its control maps as ONNX with a contract, and who flies them without torch.

Read :mod:`contract` for what is in a folder, :mod:`graph`, :mod:`networks` and :mod:`maps` for how the files are made,
and :mod:`flight` for how they are flown. :mod:`marks` says where each number of a vehicle comes from, for :mod:`mjcf`,
:mod:`sdf`, :mod:`ardusub` and :mod:`fossen`.
"""
