"""Sealed logs given to the diagnosis and to mujoco.sysid: who names the cause, who is near its size."""
