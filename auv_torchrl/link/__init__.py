"""The vehicle behind a firmware: ArduSub flies the simulator's physics in lock-step."""
