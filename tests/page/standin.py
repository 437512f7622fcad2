"""A command in place of a diagnosis, which takes no time: it says how far it is and writes what a diagnosis writes.

The name of the log decides how it ends.
"""

import json
import sys
import time
from pathlib import Path

REPORT = """<!DOCTYPE html><html lang="en"><head><title>Diagnosis</title><style>
h1 { color: rgb(1, 2, 3); }
</style></head><body><h1 id="summary">Thruster 4 is weak.</h1><p id="sign">as it was</p>
<script>document.getElementById("sign").textContent = "a script ran"; parent.document.title = "taken";</script>
<img src="https://example.invalid/pixel.png" onerror="parent.document.title = 'taken'" alt="">
</body></html>"""


def main() -> None:
    """Do what the name of the log says."""
    given = dict(word.split("=", 1) for word in sys.argv[1:])
    name = given.get("log") or given["healthy"]
    print(" 20 % following the log, 0 s so far", flush=True)
    if "slow" in name:
        print(" 40 % screening effects, 1 s so far", flush=True)
        time.sleep(60.0)
    if "wrong" in name:
        print("diagnose: this log is of no use", flush=True)
        sys.exit(2)
    if "crash" in name:
        import os

        os.kill(os.getpid(), 9)
    folder = Path(given["output"])
    if folder.suffix == ".yaml":
        folder.write_text("name: calibrated\n")
        return
    folder.mkdir(parents=True, exist_ok=True)
    history = "dives" in given
    (folder / ("dives.html" if history else "report.html")).write_text(REPORT)
    answer = {"verdict": "explained", "summary": "Thruster 4 is weak.", "where": {}, "arguments": sys.argv[1:]}
    (folder / ("dives.json" if history else "diagnosis.json")).write_text(json.dumps(answer))
    (folder / "advice.param").write_text("MOT_1_DIRECTION,1\n")
    (folder / "scenario.yaml").write_text("effects: {thruster_gain: {gain_4: 0.5}}\n")
    (folder / "diagnosis.rrd").write_bytes(b"RRF2 and what follows")
    print("100 % done, 1 s so far", flush=True)
