"""Relations between pairs of scenarios, from Python."""

import random
from typing import Any

from cases import FolderCase
import mishandle
from mishandle import Axis


def gap(scenario: dict[str, Any]) -> dict[str, list[float]]:
    """A gap that depends on a difference, and on the friction below 0.5."""
    loss = 4.0 if scenario["friction"] < 0.5 else 0.0
    return {"gap": [10.0, 10.0 - (scenario["own"] - scenario["front"]) - loss]}


def noisy(scenario: dict[str, Any], seed: int) -> dict[str, list[float]]:
    return {"gap": [10.0, scenario["own"] - 5 + random.Random(seed).gauss(0, 1)]}


SPACE = [
    Axis("own", 0, 20, "m/s"),
    Axis("front", 0, 20, "m/s"),
    Axis("friction", 0.2, 1, nominal=1, kind="model"),
]


class MetamorphicTests(FolderCase):
    def ask(
        self, system: Any, space: list[Axis], relations: Any, **asked: Any
    ) -> mishandle.ask.Metamorphic:
        out = self.folder / f"{len(list(self.folder.iterdir()))}.sqlite"
        plan = {"metamorphic": {"relations": relations, **asked}}
        return mishandle.metamorphic(system, "always(gap >= 2)", space, out=out, plan=plan)

    def test_broken_pairs_are_those_of_a_hand_calculation(self) -> None:
        found = self.ask(
            gap, SPACE,
            {
                "shift": {
                    "change": {"own": "+1", "front": "+1"}, "holds": "robustness-within:1e-9"
                },
                "slippery": {"change": {"friction": "=0.3"}, "holds": "same-verdict"}
            },
            pairs=200
        )
        shift, slippery = found.relations
        self.assertEqual((shift.name, shift.broken), ("shift", 0))
        self.assertEqual(shift.pairs + shift.out_of_bounds, 200)
        self.assertEqual(slippery.out_of_bounds, 0)
        self.assertTrue(found.is_broken)
        for pair in slippery.worst:
            source = {axis: float(value) for axis, value in pair.source.scenario.items()}
            self.assertGreaterEqual(source["friction"], 0.5)
            rest = 8 - (source["own"] - source["front"])
            self.assertTrue(0 <= rest < 4, pair)
            self.assertAlmostEqual(pair.difference, -4)
        # The friction must fall below 0.5.
        smallest = slippery.smallest_change
        assert smallest is not None
        self.assertTrue(0.49 < float(smallest.follow_up.scenario["friction"]) < 0.5)
        case = slippery.worst[0].follow_up
        file = found.export(self.folder / "pair.json", case)
        self.assertEqual(
            mishandle.replay(file, gap, "always(gap >= 2)", SPACE).robustness, case.robustness
        )

    def test_both_cases_of_a_pair_have_the_same_noise(self) -> None:
        space = [Axis("own", 0, 20)]
        same = self.ask(
            noisy, space, {"same": {"change": {"own": "*1"}, "holds": "robustness-within:0"}}
        )
        self.assertTrue(same.is_random)
        self.assertFalse(same.is_broken)
        more = self.ask(
            noisy, space, {"more": {"change": {"own": "+1"}, "holds": "not-worse:0"}}
        )
        self.assertFalse(more.is_broken)

    def test_mistakes_are_errors_before_the_system_is_simulated(self) -> None:
        def never(scenario: dict[str, Any]) -> dict[str, list[float]]:
            raise AssertionError("simulated")

        mistakes: list[tuple[dict[str, Any], str]] = [
            ({}, "relation"),
            ({"a": {"change": {"onw": "+1"}}}, "no axis `onw`"),
            ({"a": {"change": {"own": "+100"}}}, "no follow-up case in 100 pairs"),
            ({"a": {"change": {"own": "+1"}, "holds": "better"}}, "not-better"),
            ({"a": {"change": {"own": 1}}}, "it must be a text in quotes: an offset"),
            ({"a": {"changes": "+1"}}, "no key `metamorphic.relations.a.changes`"),
        ]
        for relations, part in mistakes:
            with self.subTest(relations), self.assertRaisesRegex(Exception, part):
                self.ask(never, SPACE, relations)
