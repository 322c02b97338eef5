"""A third structure, as small as one can be: every load is a network of the pose, N is minus the sensitive load.

F_l = net_l(pose),   s_p = -F_p/N0   (signed normal load: without the root, which other structures take)
"""

import casadi as ca
import numpy as np

from casadi_contact.networks.graph import network_value
from casadi_contact.networks.kernel.networks import Bundle
from casadi_contact.networks.kernel.source import Kernel, c_text
from casadi_contact.surrogate.base import Surrogate


class DirectSurrogate(Surrogate):
    structure = "direct"
    title = "direct surrogate"

    @classmethod
    def network_inputs(cls, scene):
        return dict.fromkeys((*scene.sensitive_loads, *scene.load_names), 6)

    @classmethod
    def networks_for(cls, scene, loads):
        return list(loads)

    @staticmethod
    def regressions(samples):
        return []

    def _loads(self, poses, loads, *, derivative):
        values, slopes = zip(*(self.networks[name].value_and_gradient(poses) for name in loads), strict=True)
        return np.stack(values, axis=1), np.stack(slopes, axis=1)

    def _roots(self, poses, *, derivative):
        forces, slopes = self._loads(poses, self.scene.sensitive_loads, derivative=True)
        return -forces / self.scene.reference_load, -slopes / self.scene.reference_load

    def _expressions(self, pose, loads):
        roots, values = (
            ca.vertcat(*(network_value(self.networks[name], pose) for name in names))
            for names in (list(self.scene.sensitive_loads), loads)
        )
        return -roots / self.scene.reference_load, values

    def _kernel(self, loads, *, roots):
        forces = list(self.scene.sensitive_loads)
        names = list(dict.fromkeys((*loads, *(forces if roots else ()))))

        def table(name, chosen):
            rows = [chosen.index(n) if n in chosen else -1 for n in names]
            return f"static const int {name}[] = {{{', '.join(map(str, rows))}}};"

        code = [
            f"#define NETWORKS {len(names)}",
            f"#define REFERENCE_LOAD {self.scene.reference_load!r}",
            table("LOAD_OF_NETWORK", list(loads)),
            table("ROOT_OF_NETWORK", forces if roots else []),
            c_text("direct.h", __package__),
        ]
        return Kernel([Bundle("networks", 6, {name: self.networks[name] for name in names})], "\n".join(code))
