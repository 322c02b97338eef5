"""Progress on the terminal: work is shown as it was done, a little of it as more than none."""

from io import StringIO

from rich.console import Console

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
