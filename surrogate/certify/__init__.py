"""Calibration of predicted uncertainty: scores, conformal intervals, recalibration."""
