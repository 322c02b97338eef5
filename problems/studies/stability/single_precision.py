"""Row 7: float32 against float64, in values, gradients, Hessians and IPOPT iterations.

`SingleNetwork` is what an exported PyTorch module in its default precision would be: inputs, weights and all
arithmetic of a network in float32 (local poses and the sums over networks stay float64). For IPOPT, the CasADi
function of the surrogate with these weights is called back with its inputs and its outputs, Jacobians and Hessians
rounded to float32 (`RoundedFunction`): the sums inside are float64, so that this errs on the kind side.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.networks.activations import activation_of
from casadi_contact.networks.network import Network
from casadi_contact.scenes.load_cycle import COLUMNS, LoadCycle
from casadi_contact.scenes.walking import reference_cycle
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from casadi_contact.surrogate.two_stage.surrogate import TwoStageSurrogate
from problems import pose_estimation
from problems.common.same_poses import same_poses
from problems.studies.stability.derivative_steps import relative_error
from problems.studies.stability.methods import METHODS, SURROGATES, Bench
from problems.studies.stability.table import Line

LIFT_MM = 0.05  # of the start for IPOPT: inside contact, where both structures have derivatives


class SingleNetwork(Network):
    """A network in float32; answers are float32 numbers in float64 arrays."""

    @classmethod
    def of(cls, network: Network) -> SingleNetwork:
        """The same network with its numbers rounded."""
        return cls(
            np.float32(network.input_shift),  # type: ignore[arg-type]
            np.float32(network.input_scale),  # type: ignore[arg-type]
            tuple(np.float32(w) for w in network.weights),  # type: ignore[misc]
            tuple(np.float32(b) for b in network.biases),  # type: ignore[misc]
            np.float32(network.output_scale),  # type: ignore[arg-type]
            network.activation,
        )

    def value(self, inputs: Array) -> Array:
        return np.float64(super().value(np.float32(inputs)))  # type: ignore[arg-type,return-value]

    def value_and_gradient(self, inputs: Array) -> tuple[Array, Array]:
        value, gradient = super().value_and_gradient(np.float32(inputs))  # type: ignore[arg-type]
        return np.float64(value), np.float64(gradient)  # type: ignore[return-value]


def hessian(network: Network, inputs: Array) -> Array:
    """d²y/dx² (n, outputs, k, k) in the precision of weights and inputs, by forward differentiation layer by layer:
    J_l = σ'·W·J, H_l = σ'·W·H + σ''·(W·J)⊗(W·J)."""
    a = (inputs - network.input_shift) / network.input_scale
    j = np.broadcast_to(np.diag(1.0 / network.input_scale).astype(a.dtype), (len(a), a.shape[1], a.shape[1]))
    h = np.zeros((len(a), a.shape[1], a.shape[1], a.shape[1]), a.dtype)
    for weight, bias in zip(network.weights[:-1], network.biases[:-1], strict=True):
        z, wj = a @ weight.T + bias, np.einsum("oi,nix->nox", weight, j)
        a, slope, bend = activation_of(network.activation).derivatives(np, z, 2)
        wh = np.einsum("oi,nixy->noxy", weight, h)
        h = slope[..., None, None] * wh + bend[..., None, None] * wj[..., :, None] * wj[..., None, :]
        j = slope[..., None] * wj
    return np.asarray(np.reshape(network.output_scale, (-1, 1, 1)) * np.einsum("oi,nixy->noxy", network.weights[-1], h))


class RoundedFunction(ca.Callback):
    """A casadi.Function with inputs and outputs rounded to float32, and so its Jacobians to every order."""

    def __init__(self, function: ca.Function, name: str) -> None:
        super().__init__()
        self._function = function
        self._jacobian: RoundedFunction | None = None
        self.construct(name, {})

    def get_n_in(self) -> int:
        return int(self._function.n_in())

    def get_n_out(self) -> int:
        return int(self._function.n_out())

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return self._function.sparsity_in(i)

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return self._function.sparsity_out(i)

    def eval(self, arg: Sequence[ca.DM]) -> list[ca.DM]:
        """CasADi's call."""
        return [_rounded(out) for out in self._function.call([_rounded(a) for a in arg])]

    def has_jacobian(self) -> bool:
        return True

    def get_jacobian(self, name: str, inames: Any, onames: Any, opts: Any) -> ca.Function:
        jacobian = RoundedFunction(self._function.jacobian(), name)
        self._jacobian = jacobian  # CasADi does not keep it alive
        return jacobian


def _rounded(matrix: ca.DM) -> ca.DM:
    return ca.DM(matrix.sparsity(), np.asarray(matrix.nonzeros(), dtype=np.float32).astype(float))


class _Single(Surrogate):
    def load_and_root_function(
        self,
        loads: Iterable[str] | None = None,
        name: str = "contact_loads_and_roots",
        *,
        compiled: bool | None = None,
        batch: int | None = None,
    ) -> ca.Function:
        self.called_back = RoundedFunction(super().load_and_root_function(loads, f"{name}_64", batch=batch), name)
        return self.called_back


class SinglePatch(_Single, PatchSurrogate):
    """A patch surrogate in float32."""


class SingleTwoStage(_Single, TwoStageSurrogate):
    """A two-stage surrogate in float32."""


def in_single_precision(surrogate: Surrogate) -> Surrogate:
    """The same surrogate in float32, as described above."""
    structure = SinglePatch if isinstance(surrogate, PatchSurrogate) else SingleTwoStage
    networks = {name: SingleNetwork.of(network) for name, network in surrogate.networks.items()}
    return structure(surrogate.scene, networks, surrogate.record, surrogate.trust)


def hessian_error(surrogate: Surrogate, poses: Array) -> float:
    """Largest over the networks of the RMS relative error of Hessians in float32, entries times the input scales."""
    errors = []
    for network in surrogate.networks.values():
        # Poses moved to each network's own centre: local poses differ from them by the patch's anchor alone. The
        # forces that a second stage takes as well stay at their mean.
        inputs = np.tile(network.input_shift, (len(poses), 1))
        inputs[:, :6] += poses - poses.mean(axis=0)
        scale = network.input_scale[:, None] * network.input_scale
        true = hessian(network, inputs) * scale
        got = hessian(SingleNetwork.of(network), np.float32(inputs)) * scale  # type: ignore[arg-type]
        off = np.linalg.norm(got - true, axis=(2, 3)) / np.linalg.norm(true, axis=(2, 3))
        errors.append(np.sqrt(np.mean(off**2)))
    return float(max(errors))


def one_frame(cycle: LoadCycle, frame: int) -> LoadCycle:
    """One frame of a cycle, twice, since a cycle has two frames or more."""
    curves = {key: np.repeat(getattr(cycle, key)[frame], 2) for key in COLUMNS if key != "time_s"}
    return LoadCycle(f"{cycle.name}, frame {frame}", time_s=np.array([0.0, 1.0]), **curves)


def measure(bench: Bench, count: int = 20) -> tuple[list[Line], None]:
    """Lines of row 7: poses of the walking cycle, and pose estimation of single frames from 0.05 mm above."""
    cycle = reference_cycle()
    frames = np.linspace(0, len(cycle) - 1, count).astype(int)
    poses = bench.poses[frames]
    cells: dict[str, dict[str, float | str]] = {}
    for method in (m for m in SURROGATES if m in bench.models):
        double = bench.surrogate(method)
        single = in_single_precision(double)
        (loads, slopes), (loads32, slopes32) = double.jacobian(poses), single.jacobian(poses)
        forces = [i for i, name in enumerate(double.load_names) if name.startswith("F")]
        used: dict[str, list[int]] = {"float64": [], "float32": []}
        solved, ended = {"float64": 0, "float32": 0}, {"float64": 0, "float32": 0}
        for frame, pose in zip(frames, poses, strict=True):
            start = np.array([pose, pose]) + np.array([0.0, LIFT_MM, 0.0, 0.0, 0.0, 0.0])
            true = pose_estimation.solve(pose_estimation.build(double, one_frame(cycle, int(frame))), start).poses
            for label, model in (("float64", double), ("float32", single)):
                result = pose_estimation.solve(pose_estimation.build(model, one_frame(cycle, int(frame))), start)
                used[label].append(result.iterations)
                solved[label] += int(result.converged.all())
                ended[label] += int(same_poses(result.poses, true).all())
        cells[method] = {
            "forces off, largest [N]": float(np.abs(loads32 - loads)[:, forces].max()),
            "Jacobian, relative error": relative_error(slopes32, slopes, double.load_names),
            "Hessians of networks, relative error": hessian_error(double, poses),
            **{
                f"{label}: loads carried / ended at the pose of float64 (0.01 mm) / iterations": (
                    f"{solved[label]} / {ended[label]} / {np.median(used[label]):.0f}"
                )
                for label in used
            },
        }
    why = {m: "exists in float64 only" for m in METHODS if m not in SURROGATES}
    quantities = next(iter(cells.values()))
    return [Line(7, f"{count} frames", q, {m: c[q] for m, c in cells.items()}, why) for q in quantities], None
