"""What is said of a log that was explained: the verdict, how likely each cause is, and the sentences.

Read the modules in this order:

1. ``decision``: why each effect is named or is not.
2. ``findings``: what was noticed in the log.
3. ``conclusion``: the verdict, and how likely each cause is.
4. ``summary``: the verdict in words, and the headline.
"""
