"""Campaigns on a real Ray cluster of several nodes on this machine."""

import os
import signal
import sqlite3
import subprocess
import sys
import textwrap
import threading
import time
from typing import Any

from cases import FolderCase, batch
import gymnasium
import mishandle
import ray
from mishandle import Attribute, Axis
from mishandle.errors import InvalidStateError, InvalidTypeError
from mishandle.cluster.executors import RayExecutor, _SystemFactory
from mishandle.cluster.plans import HardeningFactory
from mishandle.systems.tasks import TaskSystem
from ray.cluster_utils import Cluster
from test_fronts import COMMAND, tables

os.environ["RAY_AUTH_MODE"] = "disabled"
# A shell starts jobs in the background with SIGINT ignored, which the programs of these tests would
# inherit.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

SPACE = [Axis("speed", 0, 10, "m/s")]
FORMULA = "always(gap >= 0.5)"

CAMPAIGN = """
target = "point-reaching"
controller = ["ppo", "sac"]
[falsify]
search = ["random", "dual-annealing"]
trials = 3
budget = 10
batch = 16
[evaluate]
episodes = 10
"""


HARDENINGS = """
target = "point-reaching"
controller = "ppo"
space = "starts+delay"
seed = [5, 6]
[axes]
action_delay = [1, 3]
[harden]
rounds = 1
steps = 256
settings = "SETTINGS"
searches = ["random"]
budget = 8
validation = 4
episodes = 4
risk = 100
margin = 10
"""

SETTINGS = """
rollout_steps = 8
episodes.environments = 16
run.validation_episodes = 2
run.validation_interval = 2
policy = { hidden = [64, 64], activation = "elu" }
"""


class RayTest(FolderCase):
    cluster: Any

    @classmethod
    def setUpClass(cls) -> None:
        cls.cluster = Cluster(
            initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False}
        )
        ray.init(address=cls.cluster.address, log_to_driver=False)

    @classmethod
    def tearDownClass(cls) -> None:
        ray.shutdown()
        cls.cluster.shutdown()

    def both(
        self, system: Any, formula: str, space: list[Axis], executor: Any = "ray", **options: Any
    ) -> Any:
        """Falsifies a system in this process and on the cluster, and compares the run files."""
        local = mishandle.falsify(system, formula, space, out=self.folder / "local", **options)
        found = mishandle.falsify(
            system, formula, space, out=self.folder / "ray", executor=executor, **options
        )
        self.assertEqual(found.largest_difference, 0.0)
        self.assertEqual(tables(self.folder / "local"), tables(self.folder / "ray"))
        self.assertGreater(local.simulations, 0)
        return found

    def test_a_function_has_the_rows_of_one_machine(self) -> None:
        # Nested, because the nodes cannot import this module.
        def braking(scenario: dict[str, Any]) -> dict[str, list[float]]:
            return {"gap": [10.0, 10.0 - scenario["speed"]]}

        found = self.both(
            braking, FORMULA, SPACE, search="random", trials=4, budget=20,
            plan=batch(8)
        )
        self.assertGreater(found.falsified_trials, 0)

    def test_a_function_without_source_runs_on_workers(self) -> None:
        # As the cell of a notebook, whose source only the sender has.
        names: dict[str, Any] = {"__name__": "__main__"}
        exec("def cell(scenario):\n    return {'gap': [10.0, 10.0 - scenario['speed']]}", names)
        self.both(
            names["cell"], FORMULA, SPACE, search="random", trials=1, budget=8, plan=batch(8)
        )

    def test_an_environment_is_made_again_on_each_worker(self) -> None:
        self.both(
            gymnasium.make("CartPole-v1"), "always(abs(angle) <= 0.15)",
            [
                Axis("low", -0.2, 0.0, nominal=-0.05),
                Axis("length", 0.2, 1.5, nominal=0.5, apply=Attribute("length"))
            ],
            policy=lambda observation: int(observation[2] + 0.3 * observation[3] > 0),
            signals={"angle": "obs[2]"}, steps=50, search="random", trials=2, budget=10,
            plan=batch(4)
        )

    def test_a_task_has_the_rows_of_one_machine(self) -> None:
        options: dict[str, Any] = {
            "policy": "ppo", "rows": 2, "search": "random", "trials": 1, "budget": 4,
            "plan": batch(4)
        }
        mishandle.falsify("point-reaching", out=self.folder / "local", **options)
        mishandle.falsify("point-reaching", out=self.folder / "ray", executor="ray", **options)
        self.assertEqual(tables(self.folder / "local"), tables(self.folder / "ray"))

    def test_a_lost_node_costs_only_what_it_had_in_hand(self) -> None:
        log = self.folder / "log"
        log.mkdir()

        def slow(scenario: dict[str, Any]) -> dict[str, list[float]]:
            with open(log / f"{os.getpid()}", "a") as file:
                file.write("x")
            time.sleep(0.1)
            return {"gap": [10.0, 10.0 - scenario["speed"]]}

        nodes = [self.cluster.add_node(num_cpus=1) for _ in range(2)]
        self.cluster.wait_for_nodes()
        executor = RayExecutor(chunk=2)

        def kill() -> None:
            # While tasks are running on the node.
            while sum(file.stat().st_size for file in log.iterdir()) < 20:
                time.sleep(0.05)
            self.cluster.remove_node(nodes[0], allow_graceful=False)

        killer = threading.Thread(target=kill)
        killer.start()
        options: dict[str, Any] = {
            "search": "random", "trials": 4, "budget": 20, "plan": batch(40)
        }
        found = mishandle.falsify(
            slow, FORMULA, SPACE, out=self.folder / "ray", executor=executor, **options
        )
        killer.join()
        self.cluster.remove_node(nodes[1])
        calls = sum(file.stat().st_size for file in log.iterdir())
        local = mishandle.falsify(slow, FORMULA, SPACE, out=self.folder / "local", **options)
        self.assertEqual(tables(self.folder / "local"), tables(self.folder / "ray"))
        # The system and the comparisons of the nominal scenario call the function 5 times, and the
        # surplus of a batch is simulated but not recorded. The lost node had one task of 2
        # simulations in hand, and perhaps a second one queued.
        surplus = calls - 5 - found.simulations
        again = sum(file.stat().st_size for file in log.iterdir()) - calls - 3 - local.simulations
        self.assertLessEqual(surplus - again, 4)

    def test_a_scenario_that_ends_its_process_is_a_crash(self) -> None:
        def fragile(scenario: dict[str, Any]) -> dict[str, list[float]]:
            if scenario["speed"] > 8:
                os._exit(1)
            return {"gap": [10.0, 10.0 - scenario["speed"]]}

        found = mishandle.falsify(
            fragile, "always(gap >= 0)", SPACE, search="random", trials=1, budget=8, plan=batch(8),
            seed=1, out=self.folder / "run", executor="ray"
        )
        speeds = mishandle.open_run(found.path).columns()
        crashed = [end for end, speed in zip(speeds["end"], speeds["speed"]) if speed > 8]
        self.assertEqual(found.trials[0].failed, len(crashed))
        self.assertGreater(len(crashed), 0)
        self.assertTrue(all(end == "crashed" for end in crashed), crashed)
        self.assertIn("ended its worker process", found.exceptions[0])

    def test_an_unknown_executor_is_an_error(self) -> None:
        with self.assertRaisesRegex(ValueError, "there is no executor 'rai'"):
            mishandle.falsify(
                "point-reaching", policy="ppo", out=self.folder / "run", executor="rai"
            )

    def test_a_worker_with_other_code_is_an_error(self) -> None:
        factory = _SystemFactory(
            TaskSystem(
                "point-reaching", lambda rows: rows, preset="paper", rows=1, batched_policy=True
            )
        )
        factory._hash = "0"
        executor = RayExecutor()
        with self.assertRaisesRegex(RuntimeError, "give all nodes the same versions"):
            executor.run(executor.share(factory), [({}, 0)])

    def test_an_exception_ends_the_run_with_its_type(self) -> None:
        def wrong(scenario: dict[str, Any]) -> dict[str, list[float]]:
            return {"gap": [1.0, 1.0]} if scenario["speed"] < 6 else {"other": [1.0, 1.0]}

        with self.assertRaisesRegex(ValueError, "lacks the signals"):
            mishandle.falsify(
                wrong, FORMULA, SPACE, search="random", budget=50, out=self.folder / "run",
                executor="ray"
            )

    def test_an_exit_in_the_system_ends_the_run_and_not_the_worker(self) -> None:
        def leaving(scenario: dict[str, Any]) -> dict[str, list[float]]:
            if scenario["speed"] > 6:
                sys.exit(3)
            return {"gap": [1.0, 1.0]}

        with self.assertRaisesRegex(
            RuntimeError, r"the system `.*leaving` raised SystemExit\(3\), which ends a run"
        ):
            mishandle.falsify(leaving, FORMULA, SPACE, search="random", budget=50, executor="ray")

    def test_a_system_that_cannot_be_sent_is_an_error_with_its_name(self) -> None:
        lock = threading.Lock()

        def locked(scenario: dict[str, Any]) -> dict[str, list[float]]:
            with lock:
                return {"gap": [1.0, 1.0]}

        expected = "`.*locked` or what it refers to cannot be sent to the workers: cannot pickle "
        expected += "'_thread.lock' object; make files"
        with self.assertRaisesRegex(InvalidTypeError, expected):
            mishandle.falsify(locked, FORMULA, SPACE, search="random", budget=5, executor="ray")

    def campaign(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        command = [
            sys.executable, "-m", "mishandle.cluster", "--address", self.cluster.address, *arguments
        ]
        return subprocess.run(
            command, capture_output=True, text=True, cwd=self.folder, timeout=1800
        )

    def test_a_campaign_has_the_rows_of_the_command_line(self) -> None:
        (self.folder / "campaign.toml").write_text(CAMPAIGN)
        ended = self.campaign("campaign.toml", "--out", "ray")
        self.assertEqual(ended.returncode, 0, ended.stderr)
        command = [
            COMMAND, "run", self.folder / "campaign.toml", "--out", self.folder / "local"
        ]
        subprocess.run(command, check=False, capture_output=True)
        local = sorted((self.folder / "local").glob("*.sqlite"))
        self.assertEqual(len(local), 6)
        for path in local:
            self.assertEqual(tables(path), tables(self.folder / "ray" / path.name), path.name)

    def test_an_interrupted_campaign_is_resumed(self) -> None:
        (self.folder / "campaign.toml").write_text(
            textwrap.dedent("""
                target = "point-reaching"
                controller = ["ppo", "sac"]
                [evaluate]
                episodes = 3000
                batch = 16
            """)
        )
        command = [sys.executable, "-m", "mishandle.cluster", "--address", self.cluster.address]
        first = subprocess.Popen(
            [*command, "campaign.toml", "--out", "runs"], cwd=self.folder, stderr=subprocess.PIPE,
            text=True
        )
        path = self.folder / "runs" / "ppo.sqlite"

        def count() -> int:
            if not (self.folder / "runs" / "campaign.toml").exists():
                return 0
            with sqlite3.connect(path) as file:
                return int(file.execute("select count(*) from simulation").fetchone()[0])

        while count() < 32:
            self.assertIsNone(first.poll())
            time.sleep(0.1)
        first.send_signal(signal.SIGINT)
        _, stderr = first.communicate(timeout=600)
        self.assertEqual(first.returncode, 130, stderr)
        self.assertIn("interrupted", stderr)
        stored = count()
        self.assertLess(stored, 3000)
        again = subprocess.Popen(
            [*command, "--resume", "runs"], cwd=self.folder, stderr=subprocess.PIPE, text=True
        )
        while count() <= stored:
            self.assertIsNone(again.poll())
            time.sleep(0.1)
        again.send_signal(signal.SIGTERM)
        _, stderr = again.communicate(timeout=600)
        self.assertEqual(again.returncode, 130, stderr)

    def test_hardenings_of_a_campaign_run_on_workers_and_continue_after_an_interruption(
        self
    ) -> None:
        text = HARDENINGS.replace("SETTINGS", str(self.folder / "settings.toml"))
        (self.folder / "settings.toml").write_text(SETTINGS)
        (self.folder / "campaign.toml").write_text(text)
        command = [sys.executable, "-m", "mishandle.cluster", "--address", self.cluster.address]
        first = subprocess.Popen(
            [*command, "campaign.toml", "--out", "ray"], cwd=self.folder, stderr=subprocess.PIPE,
            text=True
        )
        started = self.folder / "ray" / "5.harden" / "round-1" / "settings.toml"
        other = self.folder / "ray" / "6.harden" / "round-1" / "settings.toml"
        while not (started.exists() or other.exists()):
            self.assertIsNone(first.poll())
            time.sleep(0.01)
        first.send_signal(signal.SIGINT)
        _, stderr = first.communicate(timeout=600)
        self.assertEqual(first.returncode, 130, stderr)
        self.assertLess(len(list((self.folder / "ray").glob("*/result.json"))), 2)
        ended = self.campaign("--resume", "ray")
        self.assertEqual(ended.returncode, 0, ended.stderr)

        options: dict[str, Any] = {
            "policy": "ppo", "space": "starts+delay", "axes": {"action_delay": (1, 3)}, "seed": 6,
            "rounds": 1
        }
        options |= {
            "steps": 256, "settings": self.folder / "settings.toml", "budget": 8, "episodes": 4,
            "plan": {
                "harden": {"searches": ["random"], "validation": 4, "risk": 100, "margin": 10}
            }
        }
        local = mishandle.harden("point-reaching", out=self.folder / "6.safetensors", **options)
        resumed = mishandle.harden(
            "point-reaching", out=self.folder / "ray" / "6.safetensors", resume=True, **options
        )
        self.assertEqual(
            (resumed.verdict, resumed.measures, resumed.rounds),
            (local.verdict, local.measures, local.rounds)
        )
        self.assertEqual(local.simulations, resumed.simulations)
        for path in (self.folder / "6.harden").rglob("*.sqlite"):
            resumed_path = self.folder / "ray" / path.relative_to(self.folder)
            # Others have the path of the controller, and the hash of its file with training times.
            found, expected = (
                [tables(each)[name] for name in ("simulation", "trial")]
                for each in (resumed_path, path)
            )
            self.assertEqual(found, expected, path.name)

    def test_a_worker_without_the_folder_of_a_hardening_is_an_error(self) -> None:
        executor = RayExecutor()
        factory = HardeningFactory(str(self.folder / "missing"), durable=False, any_build=False)
        with self.assertRaisesRegex(InvalidStateError, "a file system that all nodes share"):
            executor.run(executor.share(factory), ["6"])

    def test_mistakes_on_the_command_line_are_errors_in_one_line(self) -> None:
        missing = self.campaign("missing.toml", "--out", "runs")
        self.assertEqual(missing.returncode, 2)
        self.assertRegex(missing.stderr, r"^error: .*missing\.toml")
        folder = self.campaign("--resume", str(self.folder))
        self.assertEqual(folder.returncode, 2)
        self.assertIn("is not the folder of a campaign", folder.stderr)
        # Nothing listens on port 9 of this machine.
        nobody = self.campaign("campaign.toml", "--out", "runs", "--address", "127.0.0.1:9")
        self.assertEqual(nobody.returncode, 2)
        self.assertRegex(nobody.stderr, r"^error: no Ray cluster answers at 127\.0\.0\.1:9: ")
        self.assertFalse((self.folder / "runs").exists())
