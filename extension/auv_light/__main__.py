"""Serve the extension: where it looks and listens comes from the environment, as containers have it."""

import os
from functools import partial
from pathlib import Path

import uvicorn

from auv_light.app import make_app
from auv_light.armed import is_armed
from auv_light.dives import Dives
from auv_light.watch import Watch

if __name__ == "__main__":
    given = os.environ.get
    dives = Dives(Path(given("AUV_LOGS", "/logs")), Path(given("AUV_KEPT", "/kept")))
    armed = partial(is_armed, given("AUV_MAVLINK", "http://host.docker.internal:6040"))
    parameters = Path(given("AUV_PARAMETERS", "/kept/vehicle.param"))
    watch = Watch(dives, given("AUV_VEHICLE", "bluerov2_heavy"), armed, parameters=parameters)
    port = int(given("AUV_PORT", "8767"))
    # all addresses of the container: the proxy of BlueOS stands before it
    uvicorn.run(make_app(watch), host="0.0.0.0", port=port, log_level="warning", access_log=False)
