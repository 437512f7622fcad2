"""Train a source policy, break the vehicle, adapt the policy from a few seconds of data, and report.

``python train.py +scenario=reversed``; every setting is in conf/train.yaml. Where the package is installed, the
command ``auv-train`` is the same.
"""

from auv_torchrl.experiment.command import main

if __name__ == "__main__":
    main()
