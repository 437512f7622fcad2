"""A policy in front of ArduSub, over MAVLink: no torch, and no library but numpy and onnxruntime.

Read :mod:`safety` for what may be sent and when, :mod:`channels` for how a command is put into messages, :mod:`known`
for which vehicles are flown, :mod:`motion` for what is measured, :mod:`pilot` for the flight, and :mod:`watch` for the
second process, which sends neutral where the first one ends.
"""
