"""Where the patella rides in a walk, and how hard it is pressed: ``python -m problems.patella --help``."""

from problems.patella.follow import Ride, follow, start_poses

__all__ = ["Ride", "follow", "start_poses"]
