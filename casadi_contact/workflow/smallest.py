"""The smallest networks of a ladder of sizes with which a surrogate still meets what is asked of it.

A fit that grows ends at the size whose error meets its own wanted error, and fits to fewer samples may have grown
further than the samples of the last round ask for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from casadi_contact.networks.network import Network
from casadi_contact.samples.errors import domain_errors
from casadi_contact.samples.samples import Samples
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.workflow.training_record import exchanged

Size = tuple[int, ...]


def smallest_networks(
    surrogate: Surrogate,
    samples: Samples,
    ladder: Sequence[Size],
    fitted: Callable[[Mapping[str, Size], Surrogate], Surrogate],
    met: Callable[[Surrogate], bool],
) -> Surrogate:
    """The surrogate with each network at the smallest size of the ladder that meets what is asked, by bisection: as if
    every size above one that does met it too.

    fitted(sizes, surrogate): the surrogate with the named networks fitted anew in these sizes. Those of one step are
    fitted side by side and judged one after the other, the largest first, beside what was taken before: errors add up.
    Of a mirrored joint a network and its twin go together.
    """
    known = set(surrogate.networks)
    twins = {twin: of for twin, of in surrogate.twins(surrogate.scene).items() if {twin, of} <= known}
    least = {name: 0 for name, network in surrogate.networks.items() if name not in twins and network.hidden in ladder}
    most = {name: ladder.index(surrogate.networks[name].hidden) for name in least}
    while names := [name for name in least if least[name] < most[name]]:
        middle = {name: (least[name] + most[name]) // 2 for name in names}
        tried = fitted({name: ladder[step] for name, step in middle.items()}, surrogate)
        taken = []
        for name in sorted(names, key=lambda name: -surrogate.networks[name].parameter_count):
            of_both = [name, *(twin for twin, of in twins.items() if of == name)]
            candidate = _with(surrogate, {each: tried.networks[each] for each in of_both})
            if met(candidate):
                surrogate, most[name] = candidate, middle[name]
                taken += of_both
            else:
                least[name] = middle[name] + 1
        surrogate = _recorded(surrogate, exchanged(surrogate.record, tried.record, taken))
    return _recorded(surrogate, {**surrogate.record, "test_errors": domain_errors(surrogate, samples)})


def _with(surrogate: Surrogate, networks: Mapping[str, Network]) -> Surrogate:
    return type(surrogate)(surrogate.scene, {**surrogate.networks, **networks}, surrogate.record)


def _recorded(surrogate: Surrogate, record: Mapping[str, object]) -> Surrogate:
    return type(surrogate)(surrogate.scene, surrogate.networks, record)
