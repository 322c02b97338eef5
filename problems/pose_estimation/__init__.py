"""Pose estimation from measured contact forces and centres of pressure: build a problem, solve it.

Run ``python -m problems.pose_estimation --help``.
"""

from problems.pose_estimation.completion import complete
from problems.pose_estimation.problem import FREE, LOADS, PoseEstimation, build
from problems.pose_estimation.solve import PoseResult, solve

__all__ = ["FREE", "LOADS", "PoseEstimation", "PoseResult", "build", "complete", "solve"]
