"""The history models by name, each fitted on the reference motion and given in sequence and on single poses."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np

from casadi_contact.samples.reference import ReferenceMotion
from casadi_contact.workflow.benchmark.candidate import Candidate
from casadi_contact.workflow.benchmark.peers.history.cycles import Cycles
from casadi_contact.workflow.benchmark.peers.history.hammerstein_wiener import hammerstein_wiener
from casadi_contact.workflow.benchmark.peers.history.in_time import HistoryModel, InSequence, SinglePoses
from casadi_contact.workflow.benchmark.peers.history.narx import narx
from casadi_contact.workflow.benchmark.peers.history.time_delay import time_delay
from casadi_contact.workflow.benchmark.peers.stopwatch import one_call, single_calls
from casadi_contact.workflow.benchmark.peers.training_set import TrainingSet

HISTORY_MODELS: dict[str, Callable[[Cycles, float], HistoryModel]] = {
    "time-delay network": time_delay,
    "NARX network": narx,
    "Hammerstein-Wiener": hammerstein_wiener,
}
"""By family: the fit of a model on cycles within a budget of 10⁹ floating-point operations."""


def history(family: str, data: TrainingSet, gflop: float, motion: ReferenceMotion | None) -> Iterator[Candidate]:
    """A history model trained on the motion's cycles, in sequence and on single poses.

    The samples have no order in time, so these peers alone are trained on the reference motion's frames, with the
    teacher's loads. Some whole cycles are held back to judge the fit. Raises ValueError without a motion of at least
    2 cycles.
    """
    began = time.process_time()
    cycles = Cycles.of(data, motion)
    fitted = HISTORY_MODELS[family](cycles, gflop)
    took = time.process_time() - began
    # The cycles that were held back: the same frames once with and once without their past.
    poses, loads = cycles.judged
    wanted = loads.reshape(-1, loads.shape[2])
    models: tuple[InSequence | SinglePoses, ...] = (
        InSequence(fitted, data.load_names, cycles.frames),
        SinglePoses(fitted, data.load_names),
    )
    share = [float(np.mean(((m(poses.reshape(-1, 6)) - wanted) / cycles.spread) ** 2) ** 0.5) for m in models]
    for model, what in zip(models, ("in sequence", "single poses"), strict=True):
        yield Candidate(
            f"{family}, {what}",
            family,
            model,
            time_value=single_calls(model.one),
            time_batch=one_call(model),
            samples=int((~cycles.validation).sum()),
            training_seconds=took,
            parameters=fitted.parameter_count,
            remark=(
                f"{fitted.remark}, knows only the reference motion; RMS error on "
                f"its validation cycles in shares of the loads' deviation: {share[0]:.4f} in sequence, "
                f"{share[1]:.4f} on single poses"
            ),
        )
