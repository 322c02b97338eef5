"""Sample-point definitions: which pose parameters and loads are given, and which follow [EF15 §2.1, §3.2]."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from casadi_contact.core.conventions import POSE_NAMES, WRENCH_NAMES
from casadi_contact.scenes.pose_space import PoseSpace
from casadi_contact.scenes.scene import Scene


@dataclass(frozen=True)
class SamplePoint:
    """Inputs (pose parameters and loads, any mix) and the free pose parameters a static analysis finds for them.

    Every pose parameter that the scene neither locks nor ties (`movable`) is an input or free, and there is one load
    for each free parameter: the knee's is {tx, Fy_med, tz, Fy_lat, ry, rz} -> (ty, rx).
    """

    inputs: tuple[str, ...]
    free: tuple[str, ...]
    movable: tuple[str, ...] = POSE_NAMES

    def __post_init__(self) -> None:
        if len(set(self.inputs)) != len(self.inputs):
            raise ValueError(f"sample point inputs {', '.join(self.inputs)} repeat a name, expected each once")
        if sorted((*self.free, *self.pose_inputs)) != sorted(self.movable):
            raise ValueError(
                f"sample point has inputs {', '.join(self.inputs)} and free {', '.join(self.free)}, "
                f"expected each of {', '.join(self.movable)} in exactly one of them"
            )
        for name in self.load_inputs:
            if name.partition("_")[0] not in WRENCH_NAMES:
                raise ValueError(f"sample point input {name!r} is neither a pose parameter nor a load")
        if len(self.load_inputs) != len(self.free):
            raise ValueError(
                f"sample point has {len(self.load_inputs)} loads for {len(self.free)} free pose parameters "
                f"({', '.join(self.free)}), expected one load for each"
            )

    @property
    def pose_inputs(self) -> tuple[str, ...]:
        """Inputs that are pose parameters, in input order."""
        return tuple(name for name in self.inputs if name in POSE_NAMES)

    @property
    def load_inputs(self) -> tuple[str, ...]:
        """Inputs that are loads, in input order."""
        return tuple(name for name in self.inputs if name not in POSE_NAMES)

    def columns(self, names: Sequence[str]) -> list[int]:
        """Columns of these inputs in an array of inputs."""
        return [self.inputs.index(name) for name in names]

    @classmethod
    def of_inputs(cls, inputs: Sequence[str], space: PoseSpace | None = None) -> SamplePoint:
        """The definition with these inputs; the pose parameters of the space that are not among them are free."""
        movable = POSE_NAMES if space is None else space.free_names
        return cls(tuple(inputs), tuple(name for name in movable if name not in inputs), movable)

    @classmethod
    def of_scene(cls, scene: Scene) -> SamplePoint:
        """[EF15 §3.2]: the pose parameters, each sensitive one replaced by a sensitive load (see `Scene.pressed`).

        Raises ValueError for a scene without sensitive pose parameters, or with another number of them than of loads.
        """
        if not scene.sensitive_pose:
            raise ValueError(
                f"scene {scene.name} leaves loads.sensitive_pose out: find it first "
                "(cc.sensitive_directions, sampling.found_sensitive_pose), or give sampling.inputs"
            )
        loads = [name for normal in scene.pressed for name in normal.loads]
        if len(scene.sensitive_pose) != len(loads):
            raise ValueError(
                f"scene {scene.name} has {len(scene.sensitive_pose)} sensitive pose parameters for "
                f"{len(loads)} sensitive loads, expected as many; give sampling.inputs"
            )
        swap = dict(zip(scene.sensitive_pose, loads, strict=True))
        return cls.of_inputs([swap.get(name, name) for name in scene.pose_space.free_names], scene.pose_space)
