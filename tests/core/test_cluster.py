"""Work on a Dask cluster: the same results as on one machine, whatever dies on the way."""

import multiprocessing
import os
import signal
import time

import pytest

from casadi_contact.core.workers import cluster_workers
from tests.support.two_spheres import draw

distributed = pytest.importorskip("distributed", reason="extra cluster is not installed")
PATIENCE = 3000  # tenths of a second


@pytest.fixture(scope="module")
def forked():
    """Workers are forked from a process that has imported what they need, which each would take seconds for."""
    import dask
    from distributed.utils import get_mp_context

    settings = {
        "distributed.worker.multiprocessing-method": "forkserver",
        "distributed.scheduler.allowed-failures": 20,  # a task may end as many workers as the tests kill
        "distributed.admin.large-graph-warning-threshold": "1GB",
        "distributed.comm.timeouts.connect": "10s",  # to one that was killed, 30 s by default
    }
    with dask.config.set(settings):
        get_mp_context()  # sets what it imports by itself
        multiprocessing.set_forkserver_preload(
            ["distributed", "casadi_contact.networks.training", "tests.support.two_spheres"]
        )
        yield


@pytest.fixture
def cluster(forked):
    with distributed.LocalCluster(n_workers=4, threads_per_worker=1, dashboard_address=None) as running:
        yield running


class Killer:
    """Kills one worker after another, each time it is called, until `count` are dead."""

    def __init__(self, address, count):
        self.client, self.left, self.killed = distributed.Client(address, set_as_default=False), count, []

    def __call__(self, *progress):
        for _ in range(PATIENCE if self.left else 0):
            pids = self.client.run(os.getpid, on_error="ignore").values()
            if fresh := sorted(set(pids) - set(self.killed)):
                self.killed.append(fresh[0])
                os.kill(fresh[0], signal.SIGKILL)
                self.left -= 1
                return
            time.sleep(0.1)
        assert not self.left, "no worker was started in the place of those killed"


def test_killed_workers_do_not_change_a_sample(cluster, tmp_path):
    draw(tmp_path / "here.h5")
    killer = Killer(cluster.scheduler_address, 3)
    with killer.client, cluster_workers(cluster.scheduler_address) as executor:
        draw(tmp_path / "there.h5", executor, progress=killer)
    assert len(set(killer.killed)) == 3
    assert (tmp_path / "there.h5").read_bytes() == (tmp_path / "here.h5").read_bytes()


def test_a_scheduler_without_workers_says_how_to_start_some():
    cluster = distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=None)
    starting = cluster_workers(cluster.scheduler_address, patience_s=1.0)
    with cluster, pytest.raises(ConnectionError, match="workers"), starting:
        pass


def test_an_error_of_the_work_arrives_as_it_is_and_a_lost_scheduler_is_one_line(cluster, caplog):
    with cluster_workers(cluster.scheduler_address) as executor, pytest.raises(ZeroDivisionError):
        executor.submit(divmod, 1, 0).result()

    def lose():
        with cluster_workers(cluster.scheduler_address) as executor:
            waiting = executor.submit(time.sleep, 600)
            cluster.close()
            waiting.result()

    with pytest.raises(ConnectionError, match="lost"):
        lose()
    assert not [record for record in caplog.records if record.name == "distributed.client"], "no traceback beside it"


@pytest.mark.parametrize("scheduler", ["nowhere.json", "other.json", "tcp://127.0.0.1:9"])
def test_a_scheduler_that_is_none_is_one_line(scheduler, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(ConnectionError, match="answers"), cluster_workers(scheduler, patience_s=1.0):
        pass
