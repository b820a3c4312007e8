"""The client in C, compiled with sanitizers."""

import json
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile
import unittest

from contract import HERE, PYTHON_CART, Cart, Tank, brake
from peer import Peer, check_hello

FLAGS = ["-std=c99", "-O1", "-g", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
FLAGS += ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
built = pathlib.Path(tempfile.mkdtemp())


def tearDownModule():
    shutil.rmtree(built)


def compile_c(source):
    """Returns the program of a source file, with all warnings as errors and with sanitizers."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        raise unittest.SkipTest("no C compiler: apt-get install gcc")
    program = built / pathlib.Path(source).stem
    if not program.exists():
        subprocess.run([compiler, *FLAGS, f"-I{HERE / 'c'}", str(source), "-o", str(program), "-lm"], check=True)
    return str(program)


class CTank(Tank, unittest.TestCase):
    folder = HERE / "c"

    @classmethod
    def setUpClass(cls):
        cls.command = [compile_c(HERE / "c/tank.c")]


class CCart(Cart, unittest.TestCase):
    folder = HERE / "c"

    @classmethod
    def setUpClass(cls):
        cls.command = [compile_c(HERE / "c/cart.c")]
        words = [json.dumps(cls.command), json.dumps([sys.executable, str(HERE / "python/cart_policy.py")])]
        (built / "cart.toml").write_text(f"process = {words[0]}\npolicy.process = {words[1]}\n")
        cls.target = [str(built / "cart.toml")]

    def test_it_is_the_cart_of_python(self):
        with self.start() as peer, Peer(PYTHON_CART, HERE / "python") as reference:
            for scenario in reference.corners():
                expected = reference.episode(scenario, policy=brake)
                self.assertEqual(peer.episode(scenario, policy=brake), expected)

    def test_a_step_before_a_reset_and_wrong_actions_are_errors(self):
        with self.start() as peer:
            self.assertIn("reset", peer.ask("step", action=[0.0])["error"])
            peer.ask("reset", seed="0", scenario=peer.nominal())
            for action in ([], [0.0, 0.0], [0.0] * 5000, [None], ["0"], 0, None):
                self.assertIn("error", peer.ask("step", action=action), action)
            self.assertNotIn("error", peer.ask("step", action=[0.0]))


# A simulator that misuses the header in the way that the axis `how` names.
MISUSES = r"""
#include "mishandle_simulator.h"
static void simulate(struct mishandle_question *question) {
    double how = mishandle_value(question, "how"), numbers[] = {1.0 / 3.0, NAN};
    setlocale(LC_ALL, "");
    printf("a stray print\n");
    if (how == 1) mishandle_value(question, "hwo");
    if (how == 2) mishandle_end(question, MISHANDLE_TERMINATED, "hit a \"wall\"\n\xff\xc3");
    if (how == 3) mishandle_end(question, MISHANDLE_INVALID, NULL);
    if (how == 4) mishandle_fail(question, "cannot do ", "this");
    for (int k = 0; k < (how == 0 ? 3 : how == 5 ? 2 : how == 6 ? 100 : 1); k++) mishandle_sample(question, numbers);
}
static const struct mishandle_simulator misuses = {
    .name = "misuses", .control_dt = 1, .steps = 2,
    .axes = {{.name = "how", .nominal = 2, .values = "fine|typo|näße 🧊|three|fail|few|many"}},
    .signals = {{.name = "a"}, {.name = "b"}}, .formulas = {{"quote", "a <= \"1\" \\"}},
    .simulate = simulate, .more = "\"files\":[\"misuses.c\"]"};
int main(void) { return mishandle_serve(&misuses); }
"""


class C(unittest.TestCase):
    """The client in C with misuse, and with lines that are no questions."""

    @classmethod
    def setUpClass(cls):
        source = built / "misuses.c"
        source.write_text(MISUSES)
        cls.command = [compile_c(source)]

    def start(self):
        return Peer(self.command, HERE)

    def test_it_compiles_as_cplusplus(self):
        if shutil.which("g++") is None:
            self.skipTest("no C++ compiler: apt-get install g++")
        for name in ("tank", "cart"):
            flags = ["-std=c++20", "-Wall", "-Wextra", "-Wpedantic", "-Wno-missing-field-initializers", "-Werror"]
            subprocess.run(["g++", *flags, "-fsyntax-only", "-x", "c++", str(HERE / f"c/{name}.c")], check=True)

    def test_misuse_is_an_error_and_categories_have_names(self):
        ask = lambda how: peer.ask("simulate", seed="1", scenario={"how": how})
        with self.start() as peer:
            check_hello(peer.hello)
            values = peer.hello["axes"][0]["values"]
            self.assertEqual((values[2], peer.hello["axes"][0]["nominal"]), ("näße 🧊", "näße 🧊"))
            self.assertEqual(peer.hello["formulas"][0]["text"], 'a <= "1" \\')
            self.assertEqual(ask("fine"), {"trace": {"a": [1 / 3] * 3, "b": [None] * 3}})
            self.assertIn("hwo", ask("typo")["error"])
            ended = ask("näße 🧊")
            self.assertEqual((ended["end"], ended["reason"]), ("terminated", 'hit a "wall"\n??'))
            self.assertEqual(ask("three"), {"end": "invalid"})
            self.assertEqual(ask("fail"), {"error": "cannot do this"})
            self.assertIn("fewer samples", ask("few")["error"])
            self.assertIn("more samples", ask("many")["error"])
            for wrong in ("dry", "", "fin", "fine|typo", "é" * 300, "x" * 5000):
                self.assertIn("how", ask(wrong)["error"])
            self.assertIn("a stray print", peer.printed())

    def test_seeds_that_are_no_64_bits_are_errors(self):
        with self.start() as peer:
            for seed in ("", "-1", "1.5", "0x1", "18446744073709551616", "9" * 40, 1, None):
                self.assertIn("error", peer.ask("simulate", seed=seed, scenario={"how": "fine"}), seed)

    def test_escapes_of_json_are_read(self):
        with self.start() as peer:
            for text in (r'{"id":9,"type":"simulate","seed":"1","scenario":{"how":"n\u00e4\u00DFe \ud83e\uddca"}}',):
                peer.send(text.encode())
                self.assertEqual(json.loads(peer.read())["end"], "terminated")

    def test_what_is_no_json_or_no_number_is_an_error(self):
        question = '{"id":1,"type":"simulate","seed":"1","scenario":{"how":0},"x":%s}%s'
        with self.start() as peer:
            wrong = ["", "01a", "+1", "0x10", "nan", "Infinity", "1e999", ".5", "tru", "[1,]", '{"a"}', "{1:2}", '"\t"', r'"\x"']
            wrong += [r'"\u12"', r'"\ud800"', r'"\ud800\u0041"', r'"\udc00"', "[" * 40 + "]" * 40, "1 2", "[1}", "'a'"]
            for value, rest in [*((value, "") for value in wrong), ("1", "}"), ("1", " 1"), ("1", ","), ("1,", "")]:
                peer.send((question % (value, rest)).encode())
                self.assertIn("no", json.loads(peer.read()).get("error", ""), (value, rest))
            peer.send((question % (' [ -1.5e-3 , {"a" : [ ] } , "\\/" ] ', " ")).encode())
            self.assertIn("trace", json.loads(peer.read()))
            peer.send(b'{"id":1,"type":"simulate","seed":"1","scenario":{"how":1e999}}')
            self.assertIn("error", json.loads(peer.read()))

    def test_every_line_has_one_answer_whatever_it_is(self):
        """Bytes at random, and questions with bytes changed, cut, doubled and nested, under the sanitizers."""
        draw = random.Random(0)
        good = json.dumps({"id": 7, "type": "simulate", "seed": "1", "scenario": {"how": "fine", "é": [1e300, {"a": None}]}})
        good = [good.encode(), good.replace('"fine"', "2").encode(), b'{"id":1,"type":"hello","protocol":1}']
        special = [b"", b"{", b"[" * 50000, b'{"a":' * 20000, b"\0" * 9, b'{"id":1e999}', b'"' + b"\\" * 999, b"x" * 200000]
        special += [b'{"id":-1,"type":"hello"}', b'{"id":0x10,"type":"hello"}', b'{"id":nan}', b'{"id":1}}', b'{"type":"\\ud800"}']
        with self.start() as peer:
            for number in range(6000):
                if number < len(special):
                    line = special[number]
                elif number % 4 == 0:
                    line = draw.randbytes(draw.randrange(200))
                else:
                    line = bytearray(draw.choice(good))
                    for _ in range(draw.randrange(1, 4)):
                        at, change = draw.randrange(len(line)), draw.randrange(4)
                        if change == 0:
                            line[at] = draw.randrange(256)
                        elif change == 1:
                            del line[at : at + draw.randrange(1, 9)]
                        elif change == 2:
                            line[at:at] = draw.choice([b'"', b"{", b"[", b"\\u", b"1e9", b"-", b",", line[:at]])
                        else:
                            del line[at:]
                        line = line or bytearray(b" ")
                peer.send(bytes(line).replace(b"\n", b" "))
                answer = json.loads(peer.read())
                self.assertIsInstance(answer["id"], int)
            self.assertEqual(peer.ask("simulate", seed="1", scenario={"how": "three"}), {"end": "invalid"})
            self.assertEqual(peer.close(), (0, b""))
            self.assertNotIn("ERROR", peer.printed())
