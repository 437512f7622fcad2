"""Diagnose a simulator that is not ours: a two-joint MuJoCo arm whose elbow sticks and whose hand carries a load.

The engine knows nothing of arms. It asks for one step of the simulator, and says which parameters of the model differ
from those of the arm that wrote the log, how sure this is, and why: ``python examples/own_simulator.py``.
"""

import mujoco
import numpy as np

from auv_torchrl import sysid

ARM = """
<mujoco><option timestep="0.01" integrator="implicitfast"/><worldbody>
  <body>
    <joint name="shoulder" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="1.5"/>
    <body pos="0.4 0 0">
      <joint name="elbow" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.025" mass="1.0"/>
      <body name="hand" pos="0.3 0 0"><geom type="sphere" size="0.03" mass="0.2"/></body>
    </body>
  </body>
</worldbody></mujoco>
"""


class Arm(sysid.StepModel):
    """Angles and rates of two joints, driven by two torques; encoders and gyroscopes measure both."""

    parameters = (
        sysid.Parameter("shoulder_damping", 0.4, 0.0, 3.0, "N m s/rad", tolerance=0.01),
        sysid.Parameter("elbow_damping", 0.3, 0.0, 3.0, "N m s/rad", tolerance=0.01),
        sysid.Parameter("elbow_friction", 0.0, 0.0, 2.0, "N m"),
        sysid.Parameter("hand_mass", 0.2, 0.05, 2.0, "kg", tolerance=0.005),
        sysid.Parameter("shoulder_gain", 1.0, -1.0, 1.5),
        sysid.Parameter("elbow_gain", 1.0, -1.0, 1.5),
        sysid.Parameter("elbow_offset", 0.0, -0.5, 0.5, "rad"),
    )
    channels = tuple(sysid.Channel(joint, "rad", angular=True) for joint in ("shoulder", "elbow")) + (
        sysid.Channel("shoulder_rate", "rad/s"), sysid.Channel("elbow_rate", "rad/s"),
    )  # fmt: skip
    dt = 0.02
    start_width = np.array([3.2, 3.2, 10.0, 10.0])
    force_width = np.array([5.0, 3.0])  # N m
    angles = (0, 1)

    def __init__(self):
        self.mujoco = mujoco.MjModel.from_xml_string(ARM)
        self.data = mujoco.MjData(self.mujoco)

    def step(self, values, states, inputs, force):
        """MuJoCo goes two of its steps."""
        hand, after, data = self.mujoco.body("hand").id, np.empty_like(states), self.data
        for row, (at, value) in enumerate(zip(states, values, strict=True)):
            self.mujoco.dof_damping[:] = value[:2]
            self.mujoco.body_mass[hand] = value[3]
            data.qpos[:], data.qvel[:] = at[:2], at[2:]
            for _ in range(2):
                friction = value[2] * np.tanh(data.qvel[1] / 0.05)
                data.qfrc_applied[:] = inputs[row] * value[4:6] + force[row] - [0.0, friction]
                mujoco.mj_step(self.mujoco, data)
            after[row] = *data.qpos, *data.qvel
        return after

    def observe(self, values, states):
        """What encoders and gyroscopes report."""
        seen = states.copy()
        seen[..., 1] += values[:, 6][:, None]
        return seen


def flown(arm: Arm, truth: dict[str, float], seconds: float = 6.0, seed: int = 0) -> sysid.LogRecord:
    """What an arm of other values logs under random torques, with the noise of its sensors."""
    draw, steps = np.random.default_rng(seed), round(seconds / arm.dt)
    torque = np.repeat(draw.normal(size=(steps // 15, 2)) * (3.0, 1.0), 15, axis=0)
    calm = np.zeros((1, 1, len(torque), 2))
    states = arm.simulate(arm.changed(truth)[None], np.array([[[1.57, 0.0, 0.0, 0.0]]]), torque[None], calm)
    seen = arm.observe(arm.changed(truth)[None], states)[0, 0]
    noise = draw.normal(size=seen.shape) * (0.002, 0.002, 0.01, 0.01)
    return sysid.LogRecord(torque, np.arange(len(seen)) * arm.dt, seen + noise)


def main() -> None:
    """Break an arm, diagnose its log, and print what was found and how."""
    arm = Arm()
    log = flown(arm, {"elbow_friction": 0.25, "hand_mass": 0.5})
    begin = (0.8, 0.6, 0.1, 0.4, 0.5, 0.5, 0.1)  # of each parameter, in their order
    tried = [sysid.Candidate(p.name, {p.name: value}) for p, value in zip(arm.parameters, begin, strict=True)]
    windows = sysid.cut([log], arm.channels, arm.dt, steps=25)
    found = sysid.identify(arm, windows, sysid.Disturbance(np.array([0.02, 0.02])), tried, progress=print)
    print("\nFound", ", ".join(map(str, sysid.intervals(found.best))) or "nothing")
    print("Something else acts besides:", "no" if sysid.is_explained(found.best) else "yes")
    print("Probabilities:", *(f"{name} {p:.1%}" for name, p in sysid.probabilities(found.trace).items()), sep="  ")
    print("How this was decided", *found.trace.table(), sep="\n")
    print("Why?", *(f"{one.name}: {found.trace.why(one.name)}" for one in tried), sep="\n")


if __name__ == "__main__":
    main()
