"""Say where a vehicle departs from the simulator, which effect causes it, and how far the gap shrinks with it.

``python diagnose.py log=flight.csv``; every setting is in conf/diagnose.yaml. Where the package is installed, the
command ``auv-diagnose`` is the same.
"""

from auv_torchrl.monitoring.command import main

if __name__ == "__main__":
    main()
