"""Diagnosis of the gap between a flown vehicle and its simulator: where, which, how far.

Begin with ``pipeline``: its :func:`diagnose` calls the packages in the order of the work.

1. ``motion``: a log is cut into windows and followed; along the measured motion every change is a known force.
2. ``calibrate``: what healthy flights leave open of a vehicle is a prior.
3. ``identify``: the search for the effects that the log evidence asks for.
4. ``log_search`` and ``explain`` call the three for a whole log, with what ``validate`` takes back on held-out flight.
5. ``conclude``: verdict, probabilities and sentences; ``localize``: where what remains lies.
6. ``unanswered``: channels that do not follow the vehicle, weighed against faults.
7. ``verdict``, ``scenario_file``, ``report``: the answer and its files. ``command``: how all of it is called.
"""

from typing import TYPE_CHECKING

from auv_torchrl.late import late

if TYPE_CHECKING:
    from auv_torchrl.diagnosis.pipeline import diagnose
    from auv_torchrl.diagnosis.verdict import Diagnosis, Verdict

__all__ = ["Diagnosis", "Verdict", "diagnose"]

__getattr__ = late(
    __name__,
    {
        "pipeline": "diagnose",
        "verdict": "Diagnosis Verdict",
    },
)
