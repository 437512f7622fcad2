"""Nested settings with one entry changed."""

import copy


def with_entry(content, path, value):
    """A copy of ``content`` in which the entry at ``path`` is ``value``, or is removed if the value is ``...``."""
    changed = copy.deepcopy(content)
    *parents, last = path
    block = changed
    for parent in parents:
        block = block[parent]
    if value is ...:
        del block[last]
    else:
        block[last] = value
    return changed
