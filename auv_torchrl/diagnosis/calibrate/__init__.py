"""What of the gap is the vehicle's file: calibrated on healthy logs, or in all coefficients that are guesses."""
