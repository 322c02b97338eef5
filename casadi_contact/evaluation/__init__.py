"""Evaluation: errors per domain, errors and speed on an unseen walking sequence (§2.7, §3.6)."""

from casadi_contact.evaluation.errors import LoadErrors, domain_errors, load_errors
from casadi_contact.evaluation.evaluate import evaluate, evaluate_walking
from casadi_contact.evaluation.machine import machine_record
from casadi_contact.evaluation.timing import Timing, time_batch, time_single_calls
from casadi_contact.evaluation.walking import unseen_walking

__all__ = [
    "LoadErrors",
    "Timing",
    "domain_errors",
    "evaluate",
    "evaluate_walking",
    "load_errors",
    "machine_record",
    "time_batch",
    "time_single_calls",
    "unseen_walking",
]
