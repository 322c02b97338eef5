"""Measured results that the pages of results are made from, for tests that need a real result file."""

from pathlib import Path

RESULTS = Path(__file__).parents[2] / "docs" / "results" / "data"
SPEED_ACCURACY = RESULTS / "speed_accuracy.csv"
