"""What a muscle cannot do at once: activation that rises and falls with delay, and fibres behind a compliant tendon.

Both are collocated at the frames of a walk, with one Radau point an interval: ẏ_k = (y_k - y_(k-1))/h_k.

Activation: τ = 15 ms up, 60 ms down; an excitation between 0 and 1 exists where (De Groote et al., Comput Methods
Biomech Biomed Engin 12 (2009) 563-574)

    ȧ + a/τ_down >= 0,   ȧ + a/τ_up <= 1/τ_up        [1/s]

Tendon: a force f·F0 stretches it to slack·(1 + ln((f + c)/c)/k), k = ln(1 + 1/c)/0.049, c = 0.2: the curve of De Groote
et al., Ann Biomed Eng 44 (2016) 2922-2936, moved by up to 0.013 so that a tendon of slack length pulls nothing. What is
left of the musculotendon is the fibre's length l and, by its change, velocity v, and both pull alike:

    f = (a·f_l(l)·f_v(v) + f_p(l))·cos α        for every muscle and frame
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.muscle import (
    MAX_FIBRE_SPEED_PER_S,
    MuscleParameters,
    active_force_length,
    force_velocity,
    passive_force_length,
)

RISE_S, FALL_S = 0.015, 0.060
TENDON_STRAIN = 0.049  # under the greatest isometric force
_TOE = 0.2
_STIFFNESS = np.log(1.0 + 1.0 / _TOE) / TENDON_STRAIN
_LEAST_TENSION = 1e-4  # of F0: a slack tendon has no length to speak of


def rates(values: ca.MX, time_s: Array) -> ca.MX:
    """ẏ (m, n-1) of values (m, n), of every frame but the first."""
    return (values[:, 1:] - values[:, :-1]) / ca.repmat(ca.DM(np.diff(time_s)).T, values.shape[0], 1)


def activation_rows(activations: ca.MX, time_s: Array) -> ca.MX:
    """Rows (2m, n-1) that are >= 0 where excitations between 0 and 1 drive activations (m, n); about 1 in size."""
    rate, now = rates(activations, time_s), activations[:, 1:]
    return ca.vertcat(FALL_S * rate + now, 1.0 - now - RISE_S * rate)


def tension_bounds() -> tuple[float, float]:
    """Least and greatest tendon force over F0."""
    return _LEAST_TENSION, 2.0


def equilibrium_rows(
    muscles: MuscleParameters, lengths_m: Array, time_s: Array, activations: ca.MX, tensions: ca.MX
) -> ca.MX:
    """Fibre's pull less the tendon's tensions (m, n), over F0: zero in equilibrium. The first frame takes the velocity
    of the second."""
    frames = len(time_s)

    def each(values: Array) -> ca.DM:
        return ca.repmat(ca.DM(values), 1, frames)

    tendon = each(muscles.tendon_slack_length_m) * (1.0 + ca.log((tensions + _TOE) / _TOE) / _STIFFNESS)
    along, optimum = ca.DM(lengths_m.T) - tendon, each(muscles.optimal_fibre_length_m)
    fibre = ca.sqrt(along**2 + (optimum * each(np.sin(muscles.pennation_rad))) ** 2)
    length = fibre / optimum
    rate = rates(length, time_s) / MAX_FIBRE_SPEED_PER_S
    velocity = ca.horzcat(rate[:, 0], rate)
    active = activations * active_force_length(length, ca) * force_velocity(velocity, ca)
    return (active + passive_force_length(length, ca)) * along / fibre - tensions
