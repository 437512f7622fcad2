"""Which effects explain the gap: all of them weighed, the likeliest simulated and fitted.

Read the modules in this order:

1. ``hypotheses``: the candidates of every effect, and the nuisance parameters.
2. ``explanation``: a set of effects with values, and the prior of a set and of its values.
3. ``problem``: what explanations of one log are weighed by.
4. ``paths``, ``following``: the motion under an explanation, and chi-square near it as a quadratic.
5. ``assess``, ``fit``: an explanation is weighed and fitted.
6. ``before_effects``: what the log shows before any effect is known.
7. ``screen``, ``routing``, ``neighbours``, ``sure``, ``search``: from one explanation to its best neighbour.
8. ``posterior``, ``equivalence``: how sure the answer is, and what stays open.
"""
