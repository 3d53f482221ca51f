"""A Ray cluster of two nodes on this machine, in a process of its own: `python -m tests.ray_cluster`.

It prints its address; for each line that it reads it kills a node, as a power cut does, and adds another one, and
answers; it ends with its input.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from subprocess import DEVNULL, PIPE, Popen
from tempfile import TemporaryDirectory

os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
#: That a node is gone is known after some seconds instead of some ten; and tasks are as urgent as tests.
SYSTEM = {
    "health_check_initial_delay_ms": 1000,
    "health_check_period_ms": 1000,
    "health_check_failure_threshold": 4,
    "worker_niceness": 0,
}


def main() -> None:
    from ray.cluster_utils import Cluster

    head = {"num_cpus": 0, "include_dashboard": False, "_system_config": SYSTEM}
    cluster = Cluster(initialize_head=True, head_node_args=head)
    nodes = [cluster.add_node(num_cpus=1) for _ in range(2)]
    print(cluster.address, flush=True)
    for _ in sys.stdin:
        cluster.remove_node(nodes.pop(0), allow_graceful=False)
        nodes.append(cluster.add_node(num_cpus=1))
        print("done", flush=True)
    cluster.shutdown()


class RunningCluster:
    """The cluster, from outside."""

    def __init__(self, process: "Popen[str]") -> None:
        self._process = process
        self.address = process.stdout.readline().strip()

    def kill_a_node(self) -> None:
        """End a node at once; another one takes its place."""
        self._process.stdin.write("kill\n")
        self._process.stdin.flush()
        assert self._process.stdout.readline() == "done\n"


@contextmanager
def private_folder() -> Iterator[dict[str, str]]:
    """Environment in which Ray has files of its own: /tmp/ray may be another user's. Paths of its sockets are short."""
    with TemporaryDirectory(prefix="ray-", dir="/tmp", ignore_cleanup_errors=True) as folder:
        yield {"RAY_TMPDIR": folder, "TMPDIR": folder}


@contextmanager
def running_cluster(root) -> Iterator[RunningCluster]:
    """The cluster, as long as the block lasts."""
    with private_folder() as folder, Popen(
            [sys.executable, "-W", "ignore", "-m", "tests.ray_cluster"], stdin=PIPE, stdout=PIPE, stderr=DEVNULL,
            text=True, cwd=root, env={**os.environ, **folder, "PYTHONPATH": str(root)}) as process:  # fmt: skip
        try:
            yield RunningCluster(process)
        finally:
            process.stdin.close()
            process.wait(60)


if __name__ == "__main__":
    main()
