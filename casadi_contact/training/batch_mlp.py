"""Networks of one shape in training at once: the products of `mlp` with a member axis in front, in torch.

Members have rows of their own, padded to the longest one's with rows of weight zero, whose residuals and derivatives
vanish. Sums over rows are made in chunks, which a GPU works on side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.network import Network
from casadi_contact.network.activations import activation_of
from casadi_contact.training.arrays import TorchArrays
from casadi_contact.training.mlp import OUTPUT_RIDGE
from casadi_contact.training.row_loss import RowLoss
from casadi_contact.training.weights import layer_shapes, split

Columns = tuple[Array, Array, Array, Array | float]  # inputs (rows, k); targets, weights, false loads (rows,)


class BatchMlp:
    """Residuals of m networks of one output on their rows, and products with their Jacobians at accepted parameters.

    Parameters are (m, parameters), see `mlp`; ``flop`` (m,) counts for each member what `mlp.Mlp` would count.
    """

    def __init__(
        self, likes: Sequence[Network], columns: Sequence[Columns], arrays: TorchArrays, chunk_rows: int
    ) -> None:
        self.arrays, self.xp = arrays, arrays.xp
        self._activation = activation_of(likes[0].activation)
        self.shapes = layer_shapes(columns[0][0].shape[1], likes[0].hidden)
        self.parameter_count = sum(neurons * width for neurons, width in self.shapes)
        self.rows = np.array([len(targets) for _, targets, *_ in columns])
        self._chunk = min(chunk_rows, max(int(self.rows.max()), 1))
        padded = -(-int(self.rows.max()) // self._chunk) * self._chunk
        first = np.zeros((len(likes), padded, self.shapes[0][1]))
        weight, target, false = (np.zeros((len(likes), padded)) for _ in range(3))
        for m, (like, (inputs, targets, weights, false_load)) in enumerate(zip(likes, columns, strict=True)):
            first[m, : len(targets), :-1] = (inputs - like.input_shift) / like.input_scale
            first[m, : len(targets), -1] = 1.0
            target[m, : len(targets)] = targets / like.output_scale
            weight[m, : len(targets)] = weights * like.output_scale
            false[m, : len(targets)] = false_load * like.output_scale**2
        self._first = arrays.array(first)
        self._rows = RowLoss(*map(arrays.array, (target, weight, false)))
        self._values: list[Any] = []
        self._delta: list[Any] = []
        self.flop = np.zeros(len(likes), dtype=np.int64)

    def count(self, products: int, members: np.ndarray) -> None:
        """Count products of one operation pair for each row and parameter of these members (True or False, m)."""
        self.flop[members] += 2 * products * self.rows[members] * self.parameter_count

    def _forward(self, layers: list[Any]) -> list[Any]:
        """ã of every layer's input."""
        values = [self._first]
        for layer in layers[:-1]:
            z = values[-1] @ layer.mT
            a = self.arrays.empty(*z.shape[:-1], z.shape[-1] + 1)
            a[..., :-1] = self._activation.derivatives(self.xp, z, 0)[0]
            a[..., -1] = 1.0
            values.append(a)
        return values

    def _outputs(self, a: Any, layer: Any) -> Any:
        """y (m, rows) from the inputs ã of the output layer."""
        return (a @ layer.mT)[..., 0]

    def _losses(self, y: Any) -> Any:
        return 0.5 * self._rows.squares(y).sum(1)

    def _over_rows(self, left: Any, right: Any) -> Any:
        """Σ leftᵀ·right (m, j, k) over the rows of (m, rows, j) and (m, rows, k)."""
        left, right = (a.reshape(len(a), -1, self._chunk, a.shape[-1]) for a in (left, right))
        return (left.mT @ right).sum(1)

    def evaluate(self, parameters: Any, members: np.ndarray) -> tuple[Any, Array]:
        """Parameters with the output layers solved as `mlp.Mlp.evaluate` does, and ½Σr² (m,) there; infinite for what
        is not a number. members: who asked (all are evaluated, these are counted)."""
        layers = split(parameters, self.shapes)
        a = self._forward(layers)[-1]
        y = self._outputs(a, layers[-1])
        loss, (weight, residuals) = self._losses(y), self._rows.weight_and_residual(y)
        weighted = a * weight[..., None]
        gram, right = self._over_rows(weighted, weighted), self._over_rows(weighted, residuals[..., None])
        width = a.shape[-1]
        ridge = OUTPUT_RIDGE * self.xp.einsum("mii->m", gram)
        factor, failed = self.xp.linalg.cholesky_ex(gram + ridge[:, None, None] * self.arrays.identity(width))
        output = layers[-1] - self.xp.cholesky_solve(right, factor).mT
        solved = self._losses(self._outputs(a, output))
        better = self.xp.isfinite(loss) & (failed == 0) & (solved < loss)
        projected = self.xp.cat([parameters[:, :-width], output[:, 0]], 1)
        self.count(1, members)
        self.flop[members] += 2 * self.rows[members] * width**2
        losses = self.arrays.numpy(self.xp.where(better, solved, loss))
        return self.xp.where(better[:, None], projected, parameters), np.where(np.isfinite(losses), losses, np.inf)

    def losses(self, parameters: Any) -> Array:
        """½Σr² (m,) at any parameters."""
        layers = split(parameters, self.shapes)
        return np.asarray(self.arrays.numpy(self._losses(self._outputs(self._forward(layers)[-1], layers[-1]))))

    def accept(self, parameters: Any, members: np.ndarray) -> Any:
        """Make parameters current; returns the gradients Jᵀr (m, parameters). members: whose are new, for counting."""
        layers = split(parameters, self.shapes)
        self._values = self._forward(layers)
        weight, residuals = self._rows.weight_and_residual(self._outputs(self._values[-1], layers[-1]))
        self._delta = [weight[..., None]]
        for layer, a in zip(layers[:0:-1], self._values[:0:-1], strict=True):
            slope = self._activation.slope_from_value(self.xp, a[..., :-1])
            self._delta.insert(0, (self._delta[0] @ layer[..., :-1]) * slope)
        self.count(2, members)
        return self._reverse_product(residuals)

    def draw_weights(self, member: int) -> Array:
        """|∂r/∂y| (rows,) of a member at the current parameters: what rows of its preconditioner are drawn by."""
        return np.abs(self.arrays.numpy(self._delta[-1][member, : self.rows[member], 0]))

    def _reverse_product(self, rows: Any) -> Any:
        """Jᵀ·u (m, parameters) of u (m, rows)."""
        pairs = zip(self._delta, self._values, strict=True)
        return self.xp.cat([self._over_rows(d * rows[..., None], a).flatten(1) for d, a in pairs], 1)

    def gram_product(self, direction: Any, members: np.ndarray) -> Any:
        """JᵀJ·v (m, parameters)."""
        pairs = zip(self._values, split(direction, self.shapes), self._delta, strict=True)
        forward = sum(((a @ layer.mT) * delta).sum(-1) for a, layer, delta in pairs)
        self.count(2, members)
        return self._reverse_product(forward)

    def gram(self, members: Sequence[int], rows: Sequence[np.ndarray], scales: Sequence[Array]) -> Any:
        """JᵀJ (len(members), parameters, parameters) of chosen rows of these members, each row times its scale."""
        most = max(map(len, rows))
        index, scale = np.zeros((len(members), most), dtype=np.int64), np.zeros((len(members), most))
        for m, (chosen, by) in enumerate(zip(rows, scales, strict=True)):
            index[m, : len(chosen)], scale[m, : len(chosen)] = chosen, by
            self.flop[members[m]] += len(chosen) * self.parameter_count**2
        member, row = self.arrays.mask(np.array(members)[:, None]), self.arrays.mask(index)
        blocks = []
        for delta, a in zip(self._delta, self._values, strict=True):
            block = self.xp.einsum("mri,mrj->mrij", delta[member, row], a[member, row])
            blocks.append(block.flatten(2))
        jacobian = self.xp.cat(blocks, 2) * self.arrays.array(scale)[..., None]
        return jacobian.mT @ jacobian
