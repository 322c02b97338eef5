"""Pose estimation from measured loads and centres of pressure: build a problem, solve it.

Run ``python -m problems.pose_estimation --help``.
"""

from problems.pose_estimation.completion import complete
from problems.pose_estimation.problem import PoseEstimation, build
from problems.pose_estimation.solve import PoseResult, solve
from problems.pose_estimation.wanted import WantedLoads

__all__ = ["PoseEstimation", "PoseResult", "WantedLoads", "build", "complete", "solve"]
