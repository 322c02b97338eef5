"""Progress on the terminal: work is shown as it was done, a little of it as more than none."""

from io import StringIO
from itertools import count

from rich.console import Console

from casadi_contact import progress
from casadi_contact.progress import progress_bars


def test_a_fit_that_ended_early_shows_the_work_it_took():
    written = StringIO()
    with progress_bars(Console(file=written, width=120)) as update:
        update("root", 0.2, 1000.0, "Gflop")
        update("root", 0.4, 0.4, "8-8 RMS 0.1 after 0.4 Gflop, error reached")
    last = written.getvalue().strip().splitlines()[-1]
    assert "1/1" in last
    assert "after 0.4 Gflop" in last
    assert "1000" not in last


def test_a_file_is_told_of_long_work_while_it_lasts(monkeypatch):
    """A build that runs overnight into a log is not silent until its end; each other fit is told in its turn."""
    minutes = count()
    monkeypatch.setattr(progress.time, "monotonic", lambda: 60.0 * next(minutes))
    written = StringIO()
    with progress_bars(Console(file=written, width=40)) as update:
        update("root", 120.0, 1000.0, "Gflop, 20-20-20 RMS 1.2")
        assert "root 120/1000 Gflop, 20-20-20 RMS 1.2" in written.getvalue()
        update("ratios", 5.0, 100.0, "Gflop")
        assert "ratios 5/100 Gflop" in written.getvalue()


def test_short_work_is_told_once():
    written = StringIO()
    with progress_bars(Console(file=written, width=120)) as update:
        for done in range(100):
            update("samples", done, 99, "")
        assert not written.getvalue().strip()
    assert written.getvalue().count("samples") == 1
