"""Work in several processes: a script needs no guard, a killed worker is one line, a killed parent leaves nobody."""

import os
import signal
import subprocess
import sys
import time

import pytest

from casadi_contact.core.workers import worker_pool

SCRIPT = """
import os, sys, time
from casadi_contact.core.workers import worker_pool

print("ran", flush=True)

def square(x):
    return x * x

with worker_pool() as workers:
    print(sum(workers.map(square, range(5))), flush=True)
    if "wait" in sys.argv:
        print(workers.submit(os.getpid).result(), flush=True)
        workers.submit(time.sleep, 600).result()
"""


@pytest.fixture
def script(tmp_path):
    path = tmp_path / "unguarded.py"
    path.write_text(SCRIPT)
    return path


def test_a_script_without_a_main_guard_runs_once_and_simply_works(script):
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["ran", "30"]


def test_workers_have_the_variables_that_their_matrix_products_ask_for(monkeypatch):
    monkeypatch.setattr("casadi_contact.core.workers.blas_environment", lambda: {"OPENBLAS_CORETYPE": "Nehalem"})
    with worker_pool() as workers:
        assert workers.submit(os.getenv, "OPENBLAS_CORETYPE").result() == "Nehalem"
    assert os.environ.get("OPENBLAS_CORETYPE") != "Nehalem"


def test_a_killed_worker_is_one_line():
    with pytest.raises(ChildProcessError, match="killed") as error, worker_pool() as workers:
        workers.submit(os._exit, 9).result()
    assert "\n" not in str(error.value)


@pytest.mark.skipif(os.name != "posix", reason="kills as POSIX does")
def test_workers_end_when_their_parent_is_killed(script):
    with subprocess.Popen([sys.executable, script, "wait"], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        worker = int([process.stdout.readline() for _ in range(3)][-1])
        process.send_signal(signal.SIGKILL)
    for _ in range(600):
        if not alive(worker):
            return
        time.sleep(0.1)
    pytest.fail("the worker lives on")


def alive(process):
    try:
        os.kill(process, 0)
        with open(f"/proc/{process}/stat") as stat:
            return stat.read().rsplit(")")[1].split()[0] != "Z"
    except OSError:
        return False


ENDED_BY_AN_ERROR = """
import time
from casadi_contact.core.workers import cancelled_if_left, worker_pool

with worker_pool() as workers:
    futures = [workers.submit(time.sleep, 0.1) for _ in range(40)]
    with cancelled_if_left(workers, futures):
        futures[0].result()
        raise SystemExit("the disc is full")
"""
TERMINATED = """
import os, signal, time
from rich.console import Console
from casadi_contact.core.terminal import new_app, progress_bars, run_app
from casadi_contact.core.workers import worker_pool

app = new_app(add_completion=False)

@app.command()
def work() -> None:
    with progress_bars(Console()), worker_pool() as workers:
        workers.submit(os.getpid).result()
        workers.submit(time.sleep, 600)
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(600)

run_app(app, "work", [])
"""
INTERRUPTED = "interrupted: run the same command again to go on\n"


@pytest.mark.skipif(os.name != "posix", reason="kills as POSIX does")
@pytest.mark.parametrize(
    ("script", "ended"), [(ENDED_BY_AN_ERROR, (1, "", "the disc is full\n")), (TERMINATED, (130, INTERRUPTED, ""))]
)
def test_work_that_an_error_or_a_kill_ends_says_one_line_and_nothing_of_what_waited(script, ended):
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stdout.rstrip() + "\n" * bool(done.stdout), done.stderr) == ended
