"""One flight of a sound vehicle, fitted with what flights may differ in."""

from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation, rescued
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.identify.judged import Judged, leaves_much
from auv_torchrl.diagnosis.identify.leaner import until_still
from auv_torchrl.diagnosis.identify.problem import Known, Problem
from auv_torchrl.diagnosis.motion.windows import Windows
from auv_torchrl.vehicle import Vehicle


def follow_flight(windows: Windows, own: Vehicle, settings: Settings, known: Known) -> tuple[Problem, Judged]:
    """One flight under a vehicle that differs in it as flights do: by the slack of ``known``.

    A window that flew off under another flight's trim comes back once that of this flight is fitted. Lost windows
    would look like a disturbance that acts on a sound vehicle.
    """
    problem, follow = follow_windows(Problem.of(windows, own, settings, known))
    judged = rescued(problem, fit_by_simulation(problem, Explanation(), follow), follow)
    return problem, until_still(problem, judged) if leaves_much(problem, judged) else judged
