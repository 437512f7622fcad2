"""Whether the vehicle is armed, asked of the MAVLink service of BlueOS."""

import json
from urllib.error import URLError
from urllib.request import urlopen

HEARTBEAT = "/mavlink/vehicles/1/components/1/messages/HEARTBEAT"
SAFETY_ARMED = 128  # MAV_MODE_FLAG_SAFETY_ARMED of MAVLink
_PATIENCE_S = 2.0


def is_armed(service: str) -> bool | None:
    """Whether the autopilot says that it is armed; None where nobody answers.

    Args:
        service: address of MAVLink2REST, such as ``http://host.docker.internal:6040``.
    """
    try:
        with urlopen(service.rstrip("/") + HEARTBEAT, timeout=_PATIENCE_S) as answer:
            told = json.load(answer)
        return bool(int(told["message"]["base_mode"]["bits"]) & SAFETY_ARMED)
    except (URLError, OSError, ValueError, KeyError, TypeError):
        return None
