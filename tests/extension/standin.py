"""In place of a diagnosis and of the odometer: it answers at once, or as the name of the log says."""

import json
import sys
import time
from pathlib import Path


def main(module: str, words: list[str]) -> None:
    """Write what a diagnosis writes, or print what the odometer prints."""
    log = Path(words[0])
    if module == "auv_light.odometer":
        print(json.dumps({"thrusters": [{"hours": 0.5, "full_hours": 0.1, "starts": 3}] * 2}))
        return
    if "slow" in log.name:
        time.sleep(60.0)
    if "broken" in log.name:
        print("diagnose: this log is of no use")
        sys.exit(2)
    folder = Path(words[words.index("--output") + 1])
    folder.mkdir(parents=True)
    gain = {"name": "thruster_gain", "probability": 0.99, "parameters": {"gain_4": {"value": -1.0}}}
    told = {"verdict": "explained", "summary": "Thruster 4 is reversed.", "effects": [gain], "words": words}
    (folder / "diagnosis.json").write_text(json.dumps(told))
    (folder / "report.html").write_text("<h1>Thruster 4 is reversed.</h1>")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
