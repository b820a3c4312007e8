"""What the hash of a system covers, and how a resumed run is checked."""

import json
import os
import socket
import subprocess
import sys
import threading
import warnings

from cases import FolderCase
import gymnasium
import mishandle
import numpy as np
from mishandle import Attribute, Axis, MishandleError, _native
from mishandle.base.fingerprints import MAX_DEPTH, Watch, walk
from mishandle.policies.kinds import policy_hash
from test_policies import Network

SPACE = [Axis("a", 0, 1)]

HELPERS = """
import numpy as np
TABLE = np.array([1.0, GAIN])
def scaled(x):
    return inner(x)
def inner(x):
    return x * GAIN
"""

SYSTEMS = """
import array, collections, dataclasses, enum, functools, types
import numpy as np
import helpers
from helpers import scaled

NUMBER = GAIN
ARRAY = np.array([[1, GAIN]])
OBJECTS = np.array([{"gain": GAIN}], dtype=object)
NESTED = {"gains": [1, (2, {"last": GAIN})]}
NAMES = {"x", "y", "z", str(GAIN)}
FROZEN = frozenset({("x", GAIN), ("y", 1)})
QUEUE = collections.deque([GAIN])
COUNTS = collections.Counter(a=GAIN)
DEFAULTS = collections.defaultdict(lambda: GAIN)
BYTES = array.array("d", [GAIN])
SPACE = types.SimpleNamespace(gain=GAIN)
POINT = collections.namedtuple("Point", "x y")(1, GAIN)
FILE = "gains.json"

class Base:
    gain = GAIN
    def scale(self, x):
        return x * self.gain
class OtherBase:
    def scale(self, x):
        return x * GAIN
class Controller(OtherBase):
    def act(self, x):
        return self.scale(x)
    @staticmethod
    def fixed(x):
        return x + GAIN
    @classmethod
    def made(cls, x):
        return x - GAIN
    @property
    def half(self):
        return GAIN / 2
class Numbers:
    def __init__(self, k):
        self.k = k
    def __call__(self, scenario):
        return scenario["a"] * self.k
class Slots:
    __slots__ = ("k",)
    def __init__(self, k):
        self.k = k
class Words(dict):
    pass
class Listed(list):
    def __init__(self, k):
        self.k = k
class Meta(type):
    gain = GAIN
class Made(metaclass=Meta):
    pass
class Mode(enum.Enum):
    FAST = GAIN
@dataclasses.dataclass
class Settings:
    gain: float = GAIN
    more: list = dataclasses.field(default_factory=lambda: [GAIN])

PARTS = [Numbers(np.float32(GAIN)), Slots([GAIN]), Words(k=GAIN), Listed(GAIN)]
PARTS.append(Numbers(Numbers(GAIN)))

def closed(k):
    def function(s):
        return s["a"] * k
    return function
def decorated(function):
    @functools.wraps(function)
    def wrapper(s):
        return function(s)
    return wrapper
@functools.lru_cache
def cached(x):
    return x * GAIN

by_constant = lambda s: GAIN
by_global = lambda s: NUMBER
by_array = lambda s: ARRAY[0, 1]
by_objects = lambda s: OBJECTS[0]["gain"]
by_nested = lambda s: NESTED["gains"][1][1]["last"]
by_set = lambda s: sorted(NAMES)
by_frozen_set = lambda s: FROZEN
by_queue = lambda s: QUEUE[0]
by_counter = lambda s: COUNTS["a"]
by_default_dictionary = lambda s: DEFAULTS["a"]
by_bytes = lambda s: BYTES[0]
by_namespace = lambda s: SPACE.gain
by_named_tuple = lambda s: POINT.y
by_file = lambda s: open(FILE).read()
by_written_file = lambda s: open("gains.json").read()
by_class_constant = lambda s: Base.gain
by_base_method = lambda s: Controller().act(s["a"])
by_static_method = lambda s: Controller.fixed(s["a"])
by_class_method = lambda s: Controller.made(s["a"])
by_property = lambda s: Controller().half
by_metaclass = lambda s: Made.gain
by_enum = lambda s: Mode.FAST.value
by_dataclass = lambda s: Settings().gain
by_slot = lambda s: PARTS[1].k
by_dictionary_type = lambda s: PARTS[2]["k"]
by_list_type = lambda s: PARTS[3].k
by_part_of_a_part = lambda s: PARTS[4].k.k
by_helper = lambda s: scaled(s["a"])
by_module = lambda s: helpers.scaled(s["a"])
by_array_of_a_module = lambda s: helpers.TABLE[1]
by_decorator = decorated(lambda s: s["a"] * GAIN)
by_cache = lambda s: cached(s["a"])
by_inner_function = lambda s: (lambda x: scaled(x))(s["a"])
by_list = lambda s: [scaled(x) for x in range(3)]
by_closure = closed(GAIN)
by_closed_array = closed(np.array([GAIN]))
by_closed_function = closed(lambda: GAIN)
by_object = Numbers(GAIN)
by_array_of_an_object = Numbers(np.arange(3) * GAIN)
by_bound_method = Numbers(GAIN).__call__
by_partial = functools.partial(lambda s, k: s["a"] * k, k=GAIN)
by_partial_argument = functools.partial(lambda k, s: s["a"] * k, [GAIN])
by_partial_function = functools.partial(Numbers(GAIN))
by_vectorized = np.vectorize(lambda x: x * GAIN)
def by_default(s, k=GAIN):
    return k
def by_keyword_default(s, *, k={"gain": GAIN}):
    return k
def by_import(s):
    import helpers as other
    return other.TABLE
def by_imported_name(s):
    from helpers import inner
    return inner(s["a"])
def by_attribute(s):
    return by_attribute.gain
by_attribute.gain = GAIN
"""

HASHES = """
import json, sys
import systems
from mishandle.policies.kinds import policy_hash
names = [name for name in dir(systems) if name.startswith("by_")]
print(json.dumps({name: policy_hash(getattr(systems, name)) for name in names}))
"""


class Folder(FolderCase):
    def hashes(self, folder, gain, seed):
        """Returns the hash of each system in a process whose sets have another order."""
        path = self.folder / folder
        path.mkdir(exist_ok=True)
        (path / "systems.py").write_text(SYSTEMS.replace("GAIN", gain))
        (path / "helpers.py").write_text(HELPERS.replace("GAIN", gain))
        (path / "gains.json").write_text(f"[{gain}]")
        environment = {**os.environ, "PYTHONHASHSEED": seed}
        done = subprocess.run(
            [sys.executable, "-c", HASHES], cwd=path, env=environment, stdout=subprocess.PIPE,
            check=True
        )
        return json.loads(done.stdout)


class Coverage(Folder):
    def test_every_way_to_reach_a_number_is_covered_and_no_process_has_another_hash(self):
        first, again = self.hashes("one", "2.5", "1"), self.hashes("two", "2.5", "77")
        self.assertEqual(first, again)
        other = self.hashes("three", "7.25", "1")
        self.assertGreater(len(first), 45)
        self.assertEqual([name for name in first if first[name] == other[name]], [])

    def test_weights_and_attributes_of_a_network_are_covered(self):
        network = Network([1.0])
        before = policy_hash(network)
        network.scale = 2.0
        self.assertNotEqual(policy_hash(network), before)
        self.assertNotEqual(
            policy_hash(lambda observation: network(observation)),
            policy_hash(lambda o: Network([1.0])(o))
        )

    def test_arrays_with_the_same_bytes_and_another_type_differ(self):
        arrays = [
            np.zeros(2), np.zeros((2, 1)), np.zeros(2, np.int64), np.zeros(4, np.float32),
            np.array([0.0, -0.0])
        ]
        self.assertEqual(
            len({policy_hash(lambda s, array=array: array) for array in arrays}), len(arrays)
        )

    def test_what_the_hash_cannot_see_is_listed(self):
        lock, pipe = threading.Lock(), socket.socket()
        self.addCleanup(pipe.close)
        deep = []
        for _ in range(2 * MAX_DEPTH):
            deep = [deep]
        generator, process = np.random.default_rng(0), subprocess.Popen([sys.executable, "-c", ""])
        process.wait()
        missing = {
            "_thread.lock (held)": lambda s, held=lock: held,
            "socket.socket": lambda s, held=pipe: held,
            "subprocess.Popen": lambda s, held=process: held,
            "a random generator": lambda s, held=generator: held,
            f"deeper than {MAX_DEPTH}": lambda s, held=deep: held,
        }
        for text, function in missing.items():
            [gap] = walk(function).gaps.values()
            self.assertIn(text.partition(" (")[0], gap)

        def system(scenario, held=lock):
            return {"y": [scenario["a"]] * 2}

        with self.assertWarnsRegex(
            UserWarning,
            r"does not cover an object of _thread.lock \(\(default 0\)\): pass `version`"
        ):
            found = mishandle.falsify(
                system, "always(y >= 0)", SPACE, trials=1, budget=2, out=self.folder / "run.sqlite"
            )
        self.assertEqual(len(found.not_covered), 1)
        self.assertEqual(mishandle.open_run(found.path).not_covered, list(found.not_covered))
        with warnings.catch_warnings(action="error"):
            mishandle.simulate(system, "always(y >= 0)", SPACE, version="1")

    def test_values_that_a_simulation_changes_are_a_state(self):
        class Logged:
            def __init__(self, gain):
                self.gain, self.calls, self.seen = gain, 0, []

            def __call__(self, scenario):
                self.calls += 1
                self.seen.append(scenario)
                return self.gain

        def found(system):
            watch = Watch({"system": system})
            system({"a": 1})
            return watch.fingerprints()["system"].digest

        system = Logged(2.0)
        first = found(system)
        for _ in range(5):
            system({"a": 0})
        self.assertEqual(found(system), first, "now the list has elements that no walk has seen")
        self.assertEqual(found(system), found(Logged(2.0)))
        self.assertNotEqual(found(system), found(Logged(3.0)))

    def test_the_state_of_an_environment_is_what_its_episodes_set(self):
        def found(env):
            watch = Watch({"env": env})
            env.reset(seed=0)
            env.step(env.action_space.sample())
            return watch.fingerprints()["env"].digest

        fresh, used, longer = (gymnasium.make("CartPole-v1") for _ in range(3))
        used.reset(seed=5)
        used.step(1)
        self.assertEqual(found(fresh), found(used))
        longer.unwrapped.length = 0.75
        self.assertNotEqual(found(longer), found(used))

    def test_library_code_is_named_by_version(self):
        found = walk(lambda s: np.sin(gymnasium.make("CartPole-v1")))
        self.assertEqual(
            found.packages, {"numpy": np.__version__, "gymnasium": gymnasium.__version__}
        )


def slope(gain):
    def system(scenario):
        return {"y": [gain * scenario["a"]] * 2}

    return system


class Hidden:
    """A number that no hash covers."""

    def __init__(self, gain):
        self.gain = gain

    def __getstate__(self):
        return None


class Stop(Exception):
    pass


class Resumed(Folder):
    def falsify(self, system, *, stop=None, **options):
        def progress(done, total):
            if stop is not None and done >= stop:
                raise Stop

        run = options.pop("out", self.folder / "run.sqlite")
        kinds = {
            "search": "random", "trials": 1, "budget": 10, "name": "slope", "out": run,
            "progress": progress
        }
        return mishandle.falsify(system, "always(y >= -9)", SPACE, **{**kinds, **options})

    def stopped(self, system, **options):
        with self.assertRaises(Stop):
            self.falsify(system, stop=4, **options)

    def test_another_version_or_file_does_not_continue_a_run(self):
        data = self.folder / "data.bin"
        data.write_bytes(b"1")
        known = {"version": "1", "files": [data]}
        self.stopped(slope(1.0), **known)
        for system, options in [
            (slope(2.0), known), (slope(1.0), {**known, "version": "2"}),
            (slope(1.0), {"version": "1"})
        ]:
            with self.assertRaisesRegex(MishandleError, "hash of the target"):
                self.falsify(system, resume=True, **options)
        data.write_bytes(b"2")
        with self.assertRaisesRegex(MishandleError, "hash of the target"):
            self.falsify(slope(1.0), resume=True, **known)
        data.write_bytes(b"1")
        self.assertEqual(self.falsify(slope(1.0), resume=True, **known).simulations, 10)
        with self.assertRaisesRegex(
            ValueError, "nothing.bin in `files` cannot be read: No such file"
        ):
            self.falsify(
                slope(1.0), files=[self.folder / "nothing.bin"], out=self.folder / "other.sqlite"
            )
        with self.assertRaisesRegex(TypeError, "version is 2"):
            self.falsify(slope(1.0), version=2, out=self.folder / "other.sqlite")

    def test_the_first_simulation_is_repeated_where_the_hash_sees_no_difference(self):
        def reading(held):
            return lambda scenario: {"y": [held.gain * scenario["a"]] * 2}

        self.stopped(reading(Hidden(1.0)))
        with self.assertRaisesRegex(
            MishandleError,
            "although its hash is the recorded one: the first recorded simulation differs: rob"
        ):
            self.falsify(reading(Hidden(2.0)), resume=True)
        self.assertEqual(self.falsify(reading(Hidden(1.0)), resume=True).simulations, 10)

    def test_a_resume_says_what_was_not_checked(self):
        generator = np.random.default_rng(0)

        def noisy(scenario):
            return {"y": [float(generator.random())] * 2}

        with warnings.catch_warnings(action="ignore"):
            self.stopped(noisy)
        with self.assertWarnsRegex(
            UserWarning, "not deterministic, so no recorded simulation was repeated"
        ):
            self.falsify(noisy, resume=True)
        lock, other = threading.Lock(), self.folder / "other.sqlite"

        def locked(scenario, held=lock):
            return {"y": [scenario["a"]] * 2}

        self.stopped(locked, out=other, version="1")
        with self.assertWarnsRegex(
            UserWarning,
            "does not cover an object of _thread.lock .*repeating the first recorded simulation"
        ):
            self.falsify(locked, resume=True, out=other, version="1")

    def test_another_build_continues_a_run_only_if_it_is_recorded(self):
        run = self.folder / "run.sqlite"
        system = slope(1.0)
        self.stopped(system)
        real = mishandle.runs.targets._versions
        mishandle.runs.targets._versions = lambda *arguments: [*real(*arguments), ("engine", "2.0")]
        self.addCleanup(setattr, mishandle.runs.targets, "_versions", real)
        with self.assertRaisesRegex(
            MishandleError,
            "another build made the run.*recorded engine unknown, now 2.0.*plan=.*any_build.*True"
        ):
            self.falsify(system, resume=True)
        self.assertEqual(len(mishandle.open_run(run).builds), 1)
        self.stopped(system, resume=True, plan={"engine": {"any_build": True}})
        [first, second] = mishandle.open_run(run).builds
        self.assertTrue("engine 2.0" in second and "engine" not in first, (first, second))
        # It is recorded now.
        self.assertEqual(self.falsify(system, resume=True).simulations, 10)
        self.assertEqual(len(mishandle.open_run(run).builds), 2)
        mishandle.runs.targets._versions = real
        self.assertEqual(
            self.falsify(system, resume=True).simulations, 10, "nothing is added to a complete run"
        )
        found = mishandle.replay(run, system, "always(y >= -9)", SPACE, name="slope")
        self.assertEqual(found.differences, ())
        self.assertTrue(
            any("engine 2.0" in difference for difference in found.build_differences),
            found.build_differences
        )

    def test_a_comparison_calls_nothing_the_same_that_no_hash_covers(self):
        def evaluated(name, system):
            return mishandle.evaluate(
                system, "always(y >= 0.5)", SPACE, episodes=5, name="slope", version="1",
                out=self.folder / name
            ).path

        lock = threading.Lock()

        def locked(scenario, held=lock):
            return {"y": [scenario["a"]] * 2}

        runs = [
            evaluated("a", locked), evaluated("b", locked), evaluated("c", slope(1.0)),
            evaluated("d", slope(1.0))
        ]
        found = mishandle.compare(*runs[:2])
        self.assertEqual(found.first.not_covered, ("an object of _thread.lock ((default 0))",))
        for pair, same in [
            (runs[:2], "as far as their hashes cover them; not covered"),
            (runs[2:], "the same controller and target.")
        ]:
            self.assertIn(same, _native.comparison_page(*map(str, pair)))

    def test_an_attribute_that_an_axis_sets_is_restored_before_the_hash(self):
        env = gymnasium.make("CartPole-v1", max_episode_steps=5)
        space = [Axis("length", 0.3, 0.7, nominal=0.5, apply=Attribute("length"))]
        kinds = {
            "policy": lambda o: 1, "signals": {"x": "obs[0]"}, "search": "random", "trials": 1,
            "termination": "hold"
        }
        run = self.folder / "run.sqlite"
        with self.assertRaises(Stop):
            mishandle.falsify(
                env, "always(x <= 9)", space, out=run, budget=6, progress=self.stop_at(3), **kinds
            )
        found = mishandle.falsify(
            env, "always(x <= 9)", space, out=run, budget=6, resume=True, **kinds
        )
        self.assertEqual((found.simulations, env.unwrapped.length), (6, 0.5))

    def stop_at(self, number):
        def progress(done, total):
            if done >= number:
                raise Stop

        return progress
