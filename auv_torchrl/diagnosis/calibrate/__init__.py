"""A prior from healthy flights: what is known of a vehicle before a fault is looked for.

Three things differ between a simulator and a bad dive. What the vehicle's file has wrong is the same in every flight.
What differs from flight to flight, as trim and current do, has a spread. Only what is neither is a fault. This package
learns the first two from healthy flights and gives them to the search as nuisance parameters with a covariance, beside
the disturbance and the sensor noise of the healthy vehicle.

Read the modules in this order:

1. ``parameters``: the uncertain numbers of a vehicle, and a vehicle with the covariance of these numbers.
2. ``scale_ambiguity``: which changes of the numbers no motion tells.
3. ``output_error``: coefficients are fitted to windows that are simulated from their commands alone.
4. ``flights``: what several flights share, how they differ, and which disturbance they show.
5. ``standing_out``, ``correction``: without healthy flights, a file that is a guess is corrected on the log, and a
   thruster that departs from the others is none of the corrections.
6. ``calibration``: the healthy vehicle, from a first fit of all flights to the prior of the search.
7. ``vehicle_file``: a calibration as a vehicle file, and back.
"""
