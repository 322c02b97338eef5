"""Samples of a contact model, their HDF5 file, and tables of samples from elsewhere."""

from casadi_contact.dataset.samples import (
    COLUMNS,
    DOMAINS,
    ROLES,
    TEST,
    TRAIN,
    VALIDATION,
    Dropped,
    Samples,
    partial_folder,
    read_samples,
    write_samples,
)
from casadi_contact.dataset.table import read_sample_table

__all__ = [
    "COLUMNS",
    "DOMAINS",
    "ROLES",
    "TEST",
    "TRAIN",
    "VALIDATION",
    "Dropped",
    "Samples",
    "partial_folder",
    "read_sample_table",
    "read_samples",
    "write_samples",
]
