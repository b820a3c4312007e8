"""Our client against the policy server of vla-eval."""

import contextlib
import threading
import unittest
from collections.abc import Iterator
from typing import Any

import anyio
import mishandle
import numpy as np
from gymnasium.vector import SyncVectorEnv
from mishandle import Axis, PolicyServer
from mishandle.errors import PolicyServerError
from servers import Line
from vla_eval.model_servers import PredictModelServer
from vla_eval.model_servers.serve import serve_async

START = Axis("start", -1.5, 1.5, "m", nominal=1.0)
OPTIONS: dict[str, Any] = {"signals": {"place": ("obs[0]", "m")}, "steps": 20, "version": "1"}


class Chunked(PredictModelServer):
    """Predicts four actions at once; the server gives them out one by one, and forgets the rest at
    the start of an episode."""

    def __init__(self) -> None:
        super().__init__(chunk_size=4)
        self.seen: list[Any] = []
        self.starts: list[Any] = []

    def predict(self, obs: Any, ctx: Any) -> Any:
        self.seen.append(obs)
        if obs["state"][0] > 1.2:
            raise RuntimeError("out of memory")
        return {"actions": np.linspace(-2.0, 0.0, 4)[:, None] * obs["state"]}

    async def on_episode_start(self, config: Any, ctx: Any) -> None:
        self.starts.append(config)
        await super().on_episode_start(config, ctx)


@contextlib.contextmanager
def served(model: Any) -> Iterator[str]:
    """Runs the server of vla-eval in a thread."""
    ready = threading.Event()
    found: dict[str, Any] = {}

    async def run() -> None:
        async with anyio.create_task_group() as group:
            found["scope"] = group.cancel_scope
            found["token"] = anyio.lowlevel.current_token()
            found["port"] = await group.start(serve_async, model, "127.0.0.1", 0)
            ready.set()

    thread = threading.Thread(target=anyio.run, args=[run], daemon=True)
    thread.start()
    assert ready.wait(10)
    try:
        yield f"ws://127.0.0.1:{found['port']}"
    finally:
        anyio.from_thread.run_sync(found["scope"].cancel, token=found["token"])
        thread.join(10)


def chunked(place: float) -> list[float]:
    """Places with the chunks of :class:`Chunked`."""
    places = [place]
    for step in range(20):
        if step % 4 == 0:
            chunk = np.linspace(-2.0, 0.0, 4) * places[-1]
        places.append(places[-1] + 0.1 * float(np.float32(chunk[step % 4])))
    return places


class VlaEval(unittest.TestCase):
    def test_episodes_observations_and_chunks(self) -> None:
        model = Chunked()
        with served(model) as url:
            policy = PolicyServer(url, protocol="vla-eval", instruction="go home")
            episodes = mishandle.simulate(
                SyncVectorEnv([Line] * 2), "always(abs(place) <= 3)", [START], at={"start": 1.1},
                policy=policy, repeat=3, **OPTIONS
            )
            self.assertEqual(policy.metadata["model_server"], "Chunked")
        for episode in episodes:
            np.testing.assert_allclose(episode.trace["place"], chunked(1.1), atol=1e-6)
        self.assertEqual(model.seen[0]["task_description"], "go home")
        self.assertEqual(model.starts[-1], {"task": {"name": "go home"}})

    def test_an_error_of_the_server_is_a_crash(self) -> None:
        with served(Chunked()) as url:
            policy = PolicyServer(url, protocol="vla-eval")
            ends = []
            for start in (1.4, 0.5):
                [found] = mishandle.simulate(
                    Line(), "always(abs(place) <= 3)", [START], at={"start": start}, policy=policy,
                    **OPTIONS
                )
                ends.append((found.end.split(" ")[0], found.robustness, "".join(found.exceptions)))
        self.assertEqual(ends[0][:2], ("crashed", None))
        self.assertIn("observation_failed: RuntimeError: out of memory", ends[0][2])
        self.assertEqual(ends[1], ("completed", 2.5, ""))

    def test_a_server_of_the_other_protocol_is_an_error_before_the_first_simulation(self) -> None:
        with served(Chunked()) as url:
            with self.assertRaisesRegex(
                PolicyServerError,
                "did not answer within 0.5 s; is a server of the protocol 'openpi'"
            ):
                mishandle.simulate(
                    Line(), "always(abs(place) <= 3)", [START],
                    policy=PolicyServer(url, time_limit=0.5), **OPTIONS
                )
