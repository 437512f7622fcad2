"""What owners' vehicles do, in sealed cases: ``python -m benchmarks.owners stock``.

Read in this order: ``acts`` (what happens to commands), ``still`` (channels that do not follow the vehicle), ``cases``
(what is flown), ``score``, ``__main__``. Vehicles, pilots, sensors and the seal are those of ``benchmarks.blind``.
"""
