"""What learns, and how: losses, gradient steps, and one learner for each agent.

Read :mod:`~auv_torchrl.agents.learning.learner` first; :mod:`~auv_torchrl.agents.learning.learners` chooses one.
"""
