"""Runs the examples of the docstrings and of docs/guide/python.md and policy_servers.md."""

import doctest
import importlib
import os
import pathlib
import pkgutil
import re
import sys
import tempfile
import unittest

os.environ["MPLBACKEND"] = "agg"

import mishandle

ROOT = pathlib.Path(__file__).parents[2]


class Examples(unittest.TestCase):
    def test_docstrings(self):
        examples = 0
        for module in pkgutil.iter_modules(mishandle.__path__, "mishandle."):
            found = doctest.testmod(importlib.import_module(module.name))
            self.assertEqual(found.failed, 0, module.name)
            examples += found.attempted
        self.assertGreater(examples, 20)

    def test_the_page_runs_from_top_to_bottom(self):
        text = (ROOT / "docs/guide/python.md").read_text()
        blocks = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
        self.assertGreaterEqual(len(blocks), 4)
        before = os.getcwd()
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            try:
                names = {}
                for block in blocks:
                    exec(compile(block, "docs/guide/python.md", "exec"), names)
            finally:
                os.chdir(before)
        self.assertEqual(names["again"].differences, ())

    def test_the_page_of_policy_servers_runs(self):
        text = (ROOT / "docs/guide/policy_servers.md").read_text()
        blocks = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
        before = os.getcwd()
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            try:
                names = {}
                for block in blocks:
                    exec(compile(block, "docs/guide/policy_servers.md", "exec"), names)
            finally:
                os.chdir(before)
        names["server"].shutdown()
        # The policy sees 3.2 m to each side.
        self.assertGreater(abs(names["found"].counterexamples[0].scenario["start"]), 3.0)

    def test_the_table_of_the_examples_is_that_of_their_results(self):
        sys.path.insert(0, str(ROOT / "python/examples"))
        self.addCleanup(sys.path.pop, 0)
        page = (ROOT / "docs/guide/examples.md").read_text()
        with_table = importlib.import_module("recording").with_table
        self.assertEqual(with_table(page), page)
        self.assertNotEqual(with_table(page.replace("same bits", "other bits")), page.replace("same bits", "other bits"))


if __name__ == "__main__":
    unittest.main()
