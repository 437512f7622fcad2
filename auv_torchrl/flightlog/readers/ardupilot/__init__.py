"""Logs of ArduPilot vehicles: DataFlash, DataFlash as text, and MAVLink messages wherever they were recorded."""
