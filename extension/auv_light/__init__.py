"""The extension for BlueOS: after each dive a light, and how much each thruster has worked.

In the order of reading: ``watch`` (when a dive is diagnosed), ``dives`` (what is kept), ``light`` (from a verdict to
sound, look or stop), ``odometer`` (the work of each thruster), ``armed`` (whether the vehicle flies), ``app`` (what is
served).
"""
