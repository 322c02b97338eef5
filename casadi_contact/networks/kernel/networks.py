"""Networks of one input and shape side by side, packed as the layers of ``core.h`` read them."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.networks.names import comment_text, identifier
from casadi_contact.networks.network import Network

WIDTH = 8  # every padded layer is a multiple of this


def padded(count: int) -> int:
    """Neurons of a layer with those that only fill it up."""
    return -(-count // WIDTH) * WIDTH


def filled_up(rows: Array) -> Array:
    """Rows filled up with zeros to a multiple of WIDTH."""
    return np.pad(rows, ((0, 0), (0, padded(rows.shape[1]) - rows.shape[1])))


@dataclass(frozen=True)
class Shape:
    """What decides the C code of a group: sigmoid, inputs, hidden layers, number of networks. Offsets count doubles.

    Packed weights: shift, filled up | first layer, all networks in one row | further layers, network after network |
    output weights, network after network | output biases | further layers turned, network after network. A layer is its
    biases, then one row per input; turned, for the way back, zeros and then one row per output. One network of several
    outputs ends in a layer like the others instead.
    """

    activation: str
    inputs: int
    hidden: tuple[int, ...]
    count: int
    outputs: int = 1

    @property
    def symbol(self) -> str:
        """What names the shape in C."""
        sizes = "_".join(map(str, (self.inputs, *self.hidden)))
        return f"{self.activation}_{sizes}_by_{self.count}" + ("" if self.outputs == 1 else f"_to_{self.outputs}")

    @property
    def last(self) -> int:
        """The last hidden layer."""
        return len(self.hidden) - 1

    @property
    def rows(self) -> tuple[int, ...]:
        """Padded neurons of one network, by layer."""
        return tuple(padded(h) for h in self.hidden)

    @property
    def stacked(self) -> tuple[int, ...]:
        """Padded neurons of all networks, by layer."""
        return tuple(self.count * row for row in self.rows)

    @property
    def widest(self) -> int:
        """Doubles of the largest layer, all networks together."""
        return max(*self.stacked, padded(self.outputs))

    def slab(self, layer: int) -> int:
        """Doubles that one network takes in a layer."""
        fan_in = self.inputs if layer == 0 else self.hidden[layer - 1]
        return (fan_in + 1) * self.rows[layer]

    def layer(self, layer: int) -> int:
        """Where a layer begins."""
        return padded(self.inputs) + self.count * sum(self.slab(before) for before in range(layer))

    @property
    def output(self) -> int:
        """Where the output weights begin."""
        return self.layer(len(self.hidden))

    @property
    def output_bias(self) -> int:
        """Where the output biases begin."""
        return self.output + self.stacked[self.last]

    def turned_slab(self, layer: int) -> int:
        """Doubles that one network takes in a turned layer."""
        return (self.hidden[layer] + 1) * self.rows[layer - 1]

    def turned(self, layer: int) -> int:
        """Where a turned layer, the first of which is 1, begins."""
        several = self.outputs > 1
        first = self.output + (self.hidden[-1] + 1) * padded(self.outputs) if several else self.output_bias + self.count
        return padded(first) + self.count * sum(self.turned_slab(before) for before in range(1, layer))


@dataclass(frozen=True)
class Group:
    """Networks of one shape and input shift, or one network of several outputs; ``symbol`` names its weights in C."""

    symbol: str
    names: tuple[str, ...]
    networks: tuple[Network, ...]

    @property
    def shape(self) -> Shape:
        """What its networks have in common."""
        first = self.networks[0]
        return Shape(first.activation, len(first.input_shift), first.hidden, len(self.networks), first.outputs)

    def packed(self) -> Array:
        """The weights as `Shape` describes them; input and output scales are folded in."""
        nets = self.networks
        first = [filled_up(np.vstack([net.biases[0], (net.weights[0] / net.input_scale).T])) for net in nets]
        parts = [filled_up(nets[0].input_shift[None]), np.hstack(first)]
        for layer in range(1, len(self.shape.hidden)):
            parts += [filled_up(np.vstack([net.biases[layer], net.weights[layer].T])) for net in nets]
        if self.shape.outputs > 1:
            (net,) = nets
            parts.append(filled_up(net.output_scale * np.vstack([net.biases[-1], net.weights[-1].T])))
        else:
            parts += [filled_up(net.output_scale * net.weights[-1]) for net in nets]
            parts.append(filled_up(np.array([[net.output_scale * net.biases[-1][0] for net in nets]])))
        for layer in range(1, len(self.shape.hidden)):
            parts += [filled_up(np.vstack([np.zeros(net.hidden[layer - 1]), net.weights[layer]])) for net in nets]
        return np.concatenate([np.asarray(part, dtype=float).ravel() for part in parts])

    def declaration(self) -> str:
        """The weights as a C array."""
        numbers = [repr(float(number)) for number in self.packed()]
        values = ",\n  ".join(", ".join(numbers[i : i + 5]) for i in range(0, len(numbers), 5))
        names = comment_text(", ".join(self.names))
        return f"/* {names} */\nstatic const double {self.symbol}[{len(numbers)}] ALIGNED = {{\n  {values}}};\n"


@dataclass(frozen=True)
class Bundle:
    """Networks of one input, possibly none, evaluated together in order; ``symbol`` names their C functions."""

    symbol: str
    inputs: int
    networks: Mapping[str, Network]

    def __post_init__(self) -> None:
        identifier(self.symbol)

    @cached_property
    def groups(self) -> tuple[Group, ...]:
        """Neighbours of one output, equal shape and input shift; networks of several outputs alone."""

        def key(item: tuple[str, Network]) -> object:
            name, network = item
            alone = name if network.outputs > 1 else ""
            return alone, network.hidden, network.activation, network.input_shift.tobytes()

        groups = []
        for i, (_, members) in enumerate(itertools.groupby(self.networks.items(), key)):
            names, networks = zip(*members, strict=True)
            groups.append(Group(f"{self.symbol}_weights_{i}", names, networks))
        return tuple(groups)
