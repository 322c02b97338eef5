"""Poses of all bodies of an assembly over a cycle: ``python -m problems.assembly_poses --help``."""

from problems.assembly_poses.cycle import AssemblyCycle
from problems.assembly_poses.problem import AssemblyPoses, build
from problems.assembly_poses.solve import AssemblyResult, solve

__all__ = ["AssemblyCycle", "AssemblyPoses", "AssemblyResult", "build", "solve"]
