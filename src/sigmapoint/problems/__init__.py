"""Estimation problems from practice: one model a file, with its data or simulator and its source."""
