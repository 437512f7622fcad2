"""Which effects explain the gap: all of them weighed, the likeliest simulated and fitted.

Read the modules in this order:

1. ``hypotheses``, ``declared``, ``explanation``: the candidates of every effect, and a set of effects with values.
2. ``problem``, ``evidence``: what explanations of one log are weighed by, and the prior of a set and of its values.
3. ``following``, ``agreeing_sensor``, ``attitude``, ``onset``, ``unseen``: the log followed before any effect is known.
4. ``paths``, ``quadratics``, ``steps``, ``assess``, ``rough_values``, ``valley``, ``fit``: an explanation is fitted.
5. ``screen``, ``routing``, ``neighbours``, ``search``, ``found``: from one explanation to its best neighbour.
6. ``posterior``, ``sure``, ``equivalence``, ``half_turn``, ``detectable``: how sure the answer is, and what stays open.
"""
