"""Pictures of systems that draw themselves, in reports."""

import base64
import re
import struct
import zlib
from typing import Any

from cases import FolderCase
import gymnasium
import mishandle
import numpy as np
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv
from mishandle import Axis
from mishandle.errors import InvalidTypeError, InvalidValueError
from mishandle.base.pictures import HEIGHT, WIDTH, picture

SPACE = [Axis("speed", 0.0, 1.0, nominal=0.0)]
FORMULA = "always(place <= 8)"


def run(scenario: dict[str, Any]) -> dict[str, Any]:
    return {"place": scenario["speed"] * np.arange(21.0)}


def gray(value: float) -> Any:
    return np.full((HEIGHT, WIDTH, 3), int(value), np.uint8)


def pixels(png: bytes) -> Any:
    """Decodes an RGB image whose lines have any filter of PNG, and returns the color of its first
    pixel."""
    width, height = struct.unpack(">II", png[16:24])
    data, place = b"", 8
    while place < len(png):
        [length], kind = struct.unpack(">I", png[place : place + 4]), png[place + 4 : place + 8]
        data += png[place + 8 : place + 8 + length] if kind == b"IDAT" else b""
        place += length + 12
    line = zlib.decompress(data)
    # The first pixel of the first line has no neighbors, so every filter leaves it.
    return (width, height), list(line[1:4])


class Moving(gymnasium.Env[Any, Any]):
    """Moves at a constant speed, and shows its place as the brightness."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}
    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (1,))
    action_space = gymnasium.spaces.Box(-1, 1, (1,))

    def __init__(self, render_mode: str | None = None) -> None:
        self.render_mode = render_mode
        self.speed = 0.0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        self.place, self.speed = 0.0, (options or {}).get("speed", 0.0)
        return np.array([self.place]), {}

    def step(self, action: Any) -> Any:
        self.place += self.speed
        return np.array([self.place]), 0.0, False, False, {}

    def render(self) -> Any:
        return gray(10 * self.place)


class Pictures(FolderCase):
    def page(self, system: Any, **options: Any) -> tuple[str, mishandle.ask.Falsification]:
        found = mishandle.falsify(
            system, FORMULA, SPACE, search="random", trials=1, budget=40,
            out=self.folder / "run.sqlite", name="moving", **options
        )
        self.assertEqual(found.falsified_trials, 1)
        found.report(self.folder / "page.html", plan={"report": {"probes": 4}})
        return (self.folder / "page.html").read_text(), found

    def check(self, page: str, found: mishandle.ask.Falsification) -> None:
        """Checks that each picture shows the place at its time."""
        cause = found.trials[0].cause
        assert cause is not None
        speed = cause.scenario["speed"]
        picture = r'<img src="data:image/png;base64,([^"]*)"[^>]*>'
        frame = rf'<figure class="frame[^>]*>{picture}<figcaption>'
        frames = re.findall(frame + r"([0-9.]+) s", page)
        self.assertGreaterEqual(len(frames), 3)
        # The page begins with the failure beside the nominal simulation, where nothing moves.
        [failing, nominal] = re.findall(frame + r"<b>([^<]*)</b>, ([0-9.]+) s", page)[:2]
        self.assertTrue(failing[1].endswith(": fails") and nominal[1] == "nominal: passes")
        self.assertEqual(pixels(base64.b64decode(nominal[0])), ((WIDTH, HEIGHT), [0, 0, 0]))
        size, _ = pixels(base64.b64decode(failing[0]))
        self.assertEqual(size, (WIDTH, HEIGHT))
        for data, time in frames:
            size, color = pixels(base64.b64decode(data))
            self.assertEqual(size, (WIDTH // 2, HEIGHT // 2))
            self.assertEqual(len(set(color)), 1)
            self.assertAlmostEqual(color[0], 10 * speed * round(10 * float(time)), delta=1.01)
        self.assertIn("The system drew these pictures while the simulation was repeated", page)
        self.assertIn("Film from", page)

    def test_a_function_draws_its_trace(self) -> None:
        frame = lambda scenario, trace, samples: [
            gray(10 * trace["place"][sample]) for sample in samples
        ]
        self.check(*self.page(run, frame=frame, control_dt=0.1))

    def test_an_environment_draws_itself(self) -> None:
        options = {
            "policy": lambda observation: [0.0], "signals": {"place": "obs[0]"}, "steps": 20,
            "control_dt": 0.1
        }
        for made in (
            Moving("rgb_array"), SyncVectorEnv([lambda: Moving("rgb_array")] * 2),
            AsyncVectorEnv([lambda: Moving("rgb_array")] * 2),
            AsyncVectorEnv([lambda: Moving("rgb_array")] * 2, autoreset_mode=AutoresetMode.DISABLED)
        ):
            self.check(*self.page(made, **options))
            (self.folder / "run.sqlite").unlink()
            made.close()

    def test_a_system_without_pictures_has_none_on_its_page(self) -> None:
        page, _ = self.page(run)
        self.assertNotIn("data:image/png", page)
        self.assertNotIn("The system drew", page)

    def test_frames_that_are_none_are_errors(self) -> None:
        good = gray(0)
        for returned, message in [
            (lambda samples: [good], "there are 1 frames of .* samples"),
            (
                lambda samples: [good[..., 0] for _ in samples],
                r"shape \(480, 640\) and the type uint8; expected \(height, width, 3\)"
            ),
            (lambda samples: [good / 255 for _ in samples], "the type float64; expected .* uint8"),
            (lambda samples: [None for _ in samples], "there is no frame"),
        ]:
            with self.assertRaisesRegex(InvalidValueError, message):
                self.page(run, frame=lambda scenario, trace, samples: returned(samples))
            (self.folder / "run.sqlite").unlink()
        with self.assertRaisesRegex(InvalidTypeError, "expected a function frame"):
            self.page(run, frame=3)

    def test_pictures_of_another_trace_are_not_shown(self) -> None:
        calls: list[float] = []

        def drifting(scenario: dict[str, Any]) -> dict[str, Any]:
            calls.append(0.0)
            # The same until the report.
            return {
                "place": scenario["speed"] * np.arange(21.0) + (
                    0.5 if len(calls) > limit[0] else 0.0
                )
            }

        limit = [10**6]
        frame = lambda scenario, trace, samples: [gray(0) for _ in samples]
        found = mishandle.falsify(
            drifting, FORMULA, SPACE, search="random", trials=1, budget=40,
            out=self.folder / "run.sqlite", frame=frame, version="1"
        )
        limit[0] = 0
        found.report(self.folder / "page.html", plan={"report": {"probes": 0}})
        page = (self.folder / "page.html").read_text()
        self.assertNotIn("data:image/png", page)
        self.assertIn("There are no pictures of the failures", page)

    def test_a_renderer_that_fails_costs_the_pictures_alone(self) -> None:
        def broken(*_: Any) -> Any:
            raise RuntimeError("no display")

        page, _ = self.page(run, frame=broken)
        self.assertNotIn("data:image/png", page)
        self.assertIn("There are no pictures of the failures: ", page)
        self.assertIn("no display", page)

    def test_a_large_frame_is_averaged(self) -> None:
        frame = np.zeros((2 * HEIGHT, 2 * WIDTH, 3), np.uint8)
        frame[::2, ::2] = 200
        found = np.frombuffer(picture(frame), np.uint8)
        self.assertEqual(len(found), 3 * WIDTH * HEIGHT)
        self.assertEqual(set(found.tolist()), {50})
        odd = np.frombuffer(picture(np.full((1001, 333, 3), 7, np.uint8)), np.uint8)
        self.assertEqual(set(odd.tolist()), {7, 255})
