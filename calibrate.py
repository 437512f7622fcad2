"""Keep what healthy flights say of a vehicle as a vehicle file to train, fly and diagnose with.

``python calibrate.py 'healthy=[a.csv,b.csv]' vehicle=bluerov2_heavy output=my_vehicle.yaml``; every setting is in
conf/calibrate.yaml. Where the package is installed, the command ``auv-calibrate`` is the same.
"""

from auv_torchrl.diagnosis.command.calibrate import main

if __name__ == "__main__":
    main()
