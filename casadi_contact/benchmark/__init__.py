"""Speed against accuracy, of every model in one run on one thread; errors by domain [EF15 §2.7, Tables 2 to 4]."""

from casadi_contact.benchmark.choose import Choice, Offer, choose
from casadi_contact.benchmark.evaluate import evaluate, evaluate_walking
from casadi_contact.benchmark.measure import measure, measure_project
from casadi_contact.benchmark.sizes import Sized, chart_surrogates, train_sizes
from casadi_contact.benchmark.speed import speed
from casadi_contact.benchmark.timing import Timing, time_batch, time_single_calls
from casadi_contact.benchmark.walking import unseen_walking

__all__ = [
    "Choice",
    "Offer",
    "Sized",
    "Timing",
    "chart_surrogates",
    "choose",
    "evaluate",
    "evaluate_walking",
    "measure",
    "measure_project",
    "speed",
    "time_batch",
    "time_single_calls",
    "train_sizes",
    "unseen_walking",
]
