"""Calibration targets whose points are known exactly."""
