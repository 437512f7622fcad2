"""Sealed cases flown by ArduSub's own firmware on our physics: is the fault named from its log, and is it cured?

Read :mod:`firmware` for the program, :mod:`stack` for firmware and physics in lock-step with a pilot, :mod:`cases` for
what is drawn, :mod:`dive` for how it is flown, :mod:`motor_detection` for what ArduSub finds itself, :mod:`remedy` for
what an owner does about an answer, :mod:`work` for one case from beginning to end, and :mod:`page` for the table.
:mod:`once` flies a single dive, :mod:`recorded` is what is left of one, and :mod:`control` has policies fly.
"""
