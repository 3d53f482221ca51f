"""Engines: values are the same wherever jobs run, however many die, and what cannot run says so in one line."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from itertools import count
from types import SimpleNamespace

import pytest

from kinreach import _jobs as jobs
from kinreach._jobs import Serial, open_engine
from kinreach.baselines import get_recipe
from kinreach.cli import main
from kinreach.compare import compare
from kinreach.errors import ClusterError, InputError, InstallationError, UnknownNameError
from tests.ray_cluster import running_cluster

#: Not the same in two runs: clocks.
CLOCKS = {"solve_s", "accept_s"}
#: How long what should come within seconds is waited for [s].
LONGEST = 300
TRAIN = ("-m", "kinreach.train", "thesis-ppo-single", "--seeds", "2", "--steps", "2600")
METHODS, GOALS = ["closed-form", "placo"], 150
#: A comparison with small blocks, so that there are more than nodes.
COMPARE = (
    "import sys; from kinreach.compare import compare, _runner as runner; runner.BLOCK = 50; "
    f"compare(methods={METHODS}, goals={GOALS}, out=sys.argv[1], engine='ray', address=sys.argv[2])"
)


def thrice(job):
    for k in range(3):
        yield 10 * job + k


class TestSerial:
    def test_one_job_after_the_other(self):
        assert list(Serial().map(thrice, [1, 2])) == [(0, 10), (0, 11), (0, 12), (1, 20), (1, 21), (1, 22)]

    def test_all_is_one_job(self):
        assert Serial().split(range(7), 2) == [range(7)]

    @pytest.mark.slow
    def test_it_does_not_know_ray(self, run_python):
        code = "import sys; from kinreach.compare import compare; compare(goals=1, methods=['closed-form']); "
        done = run_python("-c", f"{code}print('ray' in sys.modules)")
        assert done.stdout.strip() == "False", done.stderr


class TestRayTask:
    @pytest.mark.parametrize(
        ("total", "least", "sizes"), [(7, 3, [3, 3, 1]), (3, 5, [3]), (0, 5, []), (25_000, 2, None)]
    )
    def test_parts_are_cut_into_jobs(self, total, least, sizes):
        cut = jobs.Ray(None).split(range(total), least)
        assert [part for job in cut for part in job] == list(range(total))
        assert len(cut) <= jobs.MAX_JOBS
        assert all(len(job) >= least for job in cut[:-1])
        assert sizes is None or [len(job) for job in cut] == sizes

    def test_values_are_sent_in_the_same_groups_each_time(self):
        here = jobs._versions()
        for _ in range(2):
            assert list(jobs._values((thrice, here, 2), 1)) == [(10, 11), (12,)]

    def test_a_node_with_other_versions_is_refused(self):
        others = {**jobs._versions(), "mujoco": "3.1.0"}
        with pytest.raises(InstallationError, match=r"has 4\.\S+ mujoco, the driver 3\.1\.0: install the same on all"):
            next(jobs._values((thrice, others, 1), 1))


class FakeRay:
    """Stands in for Ray: runs a task when the next of its values is asked for, and notes what it was asked."""

    def __init__(self, fails=None, known=False):
        self.asked, self.fails, self.known = [], fails, known
        self.exceptions = SimpleNamespace(RayTaskError=type("RayTaskError", (Exception,), {}), RayError=OSError)

    def is_initialized(self):
        return self.known

    def init(self, **options):
        if isinstance(self.fails, Exception):
            raise self.fails
        self.asked.append(options)

    def shutdown(self):
        self.asked.append("shutdown")

    def remote(self, **options):
        self.asked.append(options)
        return lambda function: SimpleNamespace(remote=lambda shared, job: function(shared, job))

    def put(self, value):
        return value

    def wait(self, streams, *, num_returns):
        assert num_returns == 1
        return streams[-1:], streams[:-1]

    def get(self, values):
        if self.fails:
            raise self.fails(self)
        return values


class TestRay:
    def test_values_come_with_the_numbers_of_their_jobs(self):
        ray = FakeRay()
        found = list(jobs.Ray(ray).map(thrice, [1, 2], threads=3, together=2))
        assert sorted(found) == [(0, 10), (0, 11), (0, 12), (1, 20), (1, 21), (1, 22)]
        assert [value for number, value in found if number == 1] == [20, 21, 22]
        assert ray.asked == [{"num_returns": "streaming", "num_cpus": 3, "max_retries": 3}]

    def test_what_a_job_raised_is_raised_and_a_lost_one_is_one_line(self):
        def failed(ray):
            error = ray.exceptions.RayTaskError()
            error.cause = InputError("of the job")
            return error

        with pytest.raises(InputError, match="of the job"):
            list(jobs.Ray(FakeRay(failed)).map(thrice, [1]))
        with pytest.raises(ClusterError, match=r"^the cluster lost a task: node died$"):
            list(jobs.Ray(FakeRay(lambda ray: OSError("node died\nand more"))).map(thrice, [1]))

    @pytest.mark.parametrize(("address", "options"), [(None, ("local", False)), ("auto", ("auto", None))])
    def test_it_is_started_and_ended_with_the_block(self, address, options, monkeypatch):
        ray = FakeRay()
        monkeypatch.setattr(jobs, "load_extra", lambda name, extra: ray)
        monkeypatch.delenv("RAY_USAGE_STATS_ENABLED", raising=False)
        with open_engine("ray", address) as engine:
            assert isinstance(engine, jobs.Ray)
            assert os.environ["RAY_USAGE_STATS_ENABLED"] == "0"
        (started, ended), (where, dashboard) = ray.asked, options
        assert (started["address"], started["include_dashboard"], ended) == (where, dashboard, "shutdown")
        assert (started["log_to_driver"], started["logging_level"]) == (False, "ERROR")

    def test_a_cluster_that_is_connected_stays(self, monkeypatch):
        ray = FakeRay(known=True)
        monkeypatch.setattr(jobs, "load_extra", lambda name, extra: ray)
        with open_engine("ray") as engine:
            assert isinstance(engine, jobs.Ray)
        assert ray.asked == []

    @pytest.mark.parametrize(
        ("address", "said"), [(None, "Ray does not start: no"), ("auto", "no Ray cluster answers at auto: no")]
    )
    def test_one_that_does_not_start_is_one_line(self, address, said, monkeypatch):
        monkeypatch.setattr(jobs, "load_extra", lambda name, extra: FakeRay(ConnectionError("no\nway")))
        with pytest.raises(ClusterError, match=f"^{said}$"), open_engine("ray", address):
            pytest.fail("it is there")


class TestBadInput:
    @pytest.mark.parametrize(
        "address", ["nonsense", "10.0.0.1", ":6379", "10.0.0.1:x", "ray://10.0.0.1:10001", "h:65536"]
    )
    def test_what_is_no_address(self, address):
        with pytest.raises(InputError, match="is host:port, such as"), open_engine("ray", address):
            pytest.fail("it is there")

    def test_nobody_answers(self):
        with (
            pytest.raises(ClusterError, match=r"answers at 127\.0\.0\.1:1 \(Connection refused\)"),
            open_engine("ray", "127.0.0.1:1"),
        ):
            pytest.fail("it is there")

    def test_engines_that_there_are_not(self):
        with (
            pytest.raises(UnknownNameError, match="unknown engine 'dask'; available: ray, serial"),
            open_engine("dask"),
        ):
            pytest.fail("it is there")
        with pytest.raises(InputError, match="an address is that of a Ray cluster"), open_engine("serial", "h:1"):
            pytest.fail("it is there")

    @pytest.mark.parametrize(
        "command", [("train", "ranked-single"), ("compare", "--goals", "1", "--methods", "closed-form")]
    )
    def test_without_ray_a_command_says_what_to_install(self, command, monkeypatch, tmp_path, capsys):
        monkeypatch.setitem(sys.modules, "ray", None)
        assert main([*command, "--engine", "ray", "--out", str(tmp_path / "out")]) == 2
        assert capsys.readouterr().err.splitlines()[0].endswith("Install it with: pip install 'kinreach[ray]'")
        assert not (tmp_path / "out").exists()


@pytest.fixture(scope="module")
def cluster(root):
    with running_cluster(root) as running:
        yield running


def start(root, *arguments):
    """A driver as an ordinary user has it, and what it says."""
    names = ("HOME", "PATH", "TMPDIR", "RAY_TMPDIR", "XDG_CACHE_HOME", "MPLCONFIGDIR")
    kept = {name: os.environ[name] for name in names if name in os.environ}
    env = {**kept, "PYTHONPATH": str(root), "OMP_NUM_THREADS": "1"}
    return subprocess.Popen([sys.executable, *map(str, arguments)], env=env, text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT)  # fmt: skip


def wait_until(true, driver):
    """Wait while a driver works."""
    for waited in count():
        if true():
            return
        assert driver.poll() is None, driver.communicate()[0]
        assert waited < 20 * LONGEST
        time.sleep(0.05)


def finish(driver):
    said, _ = driver.communicate(timeout=LONGEST)
    assert driver.returncode == 0, said
    return said


def rows(folder):
    with (folder / "results.csv").open() as file:
        return [{name: cell for name, cell in row.items() if name not in CLOCKS} for row in csv.DictReader(file)]


def numbers(folder):
    """Results without times, the machine that measured them, and the command."""
    results = json.loads((folder / "results.json").read_text())
    for name in ("machine", "command"):
        results["settings"].pop(name)
    for entry in results["methods"]:
        for name in ("solve_ms", "accept_ms"):
            entry.pop(name)
            entry.pop(f"{name}_ci")
    return json.dumps(results)


@pytest.mark.slow
def test_trainings_survive_their_driver_and_a_node(cluster, root, tmp_path):
    pytest.importorskip("torch")
    from kinreach.baselines import train

    out = tmp_path / "ray" / "thesis-ppo-single"
    driver = start(root, *TRAIN, "--engine", "ray", "--address", cluster.address, "--out", out.parent)
    wait_until(lambda: list(out.glob("*/checkpoint.pt")), driver)
    driver.send_signal(signal.SIGKILL)
    driver.communicate()
    begun = {path.parent.name: path.read_bytes() for path in out.glob("*/checkpoint.pt")}
    assert begun
    again = start(root, *TRAIN, "--engine", "ray", "--address", cluster.address, "--out", out.parent, "--resume")
    wait_until(
        lambda: any(path.read_bytes() != begun.get(path.parent.name) for path in out.glob("*/checkpoint.pt")), again
    )
    cluster.kill_a_node()
    assert "will be retried" in finish(again)
    for seed in range(2):
        here, there = tmp_path / f"serial-{seed}", out / f"seed-{seed}"
        train(get_recipe("thesis-ppo-single"), here, seed=seed, steps=2600)
        for name in ("policy.safetensors", "curve.csv"):
            assert (here / name).read_bytes() == (there / name).read_bytes(), name
        assert {path.name for path in here.iterdir()} == {path.name for path in there.iterdir()}
        assert json.loads((there / "run.json").read_text())["resumed"] == (there.name in begun)


@pytest.mark.slow
def test_a_comparison_survives_its_driver_and_a_node(cluster, root, tmp_path):
    out = tmp_path / "ray"
    kept = out / "records.jsonl"

    def trials():
        return kept.read_text().count("\n") - 1 if kept.exists() else 0

    driver = start(root, "-c", COMPARE, out, cluster.address)
    wait_until(lambda: trials() > 0, driver)
    driver.send_signal(signal.SIGKILL)
    driver.communicate()
    before = trials()
    assert 0 < before < 2 * GOALS
    again = start(root, "-c", COMPARE, out, cluster.address)
    wait_until(lambda: trials() > before, again)
    cluster.kill_a_node()
    assert "will be retried" in finish(again)
    compare(methods=METHODS, goals=GOALS, out=tmp_path / "serial")
    assert len(rows(out)) == 2 * GOALS
    assert rows(out) == rows(tmp_path / "serial")
    assert numbers(out) == numbers(tmp_path / "serial")


@pytest.mark.slow
def test_a_study_is_the_same_on_a_cluster(cluster, root):
    study = ("-m", "benchmarks.studies.button_actuation", "--targets", "3")
    drivers = [start(root, *study), start(root, *study, "--engine", "ray", "--address", cluster.address)]
    here, there = map(finish, drivers)
    assert here.count("\n| ") >= 10
    assert there == here


@pytest.mark.slow
def test_ray_on_this_machine(root, tmp_path):
    command = ("-m", "kinreach.compare", "--methods", "closed-form", "--goals", "3", "--out")
    said = finish(start(root, *command, tmp_path / "ray", "--engine", "ray"))
    assert "reached" in said
    assert "ray" not in said.lower().replace(str(tmp_path / "ray"), "")
    finish(start(root, *command, tmp_path / "serial"))
    assert rows(tmp_path / "ray") == rows(tmp_path / "serial")
    assert numbers(tmp_path / "ray") == numbers(tmp_path / "serial")
