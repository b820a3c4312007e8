"""Runs the examples of the docstrings and of docs/guide/python.md, policy_servers.md,
requirements.md, online.md and logs.md."""

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
        for module in pkgutil.walk_packages(mishandle.__path__, "mishandle."):
            try:
                imported = importlib.import_module(module.name)
            except ImportError as error:
                # The usual tests install no extras; with all tests, a missing extra is a failure.
                extras = ("mujoco_warp", "ray", "warp")
                is_extra = "needs an extra" in str(error) or error.name in extras
                if not is_extra or os.environ.get("MISHANDLE_TEST_ALL") == "1":
                    raise
                continue
            found = doctest.testmod(imported)
            self.assertEqual(found.failed, 0, module.name)
            examples += found.attempted
        self.assertGreater(examples, 20)

    def run_page(self, page, least):
        """Runs the examples of a page, of which there are a least number, in an empty folder, and
        returns their names."""
        blocks = re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(), flags=re.DOTALL)
        self.assertGreaterEqual(len(blocks), least)
        before = os.getcwd()
        names = {}
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            try:
                for block in blocks:
                    exec(compile(block, page, "exec"), names)
            finally:
                os.chdir(before)
        return names

    def test_the_page_runs_from_top_to_bottom(self):
        self.assertEqual(self.run_page("docs/guide/python.md", least=4)["again"].differences, ())

    def test_the_page_of_policy_servers_runs(self):
        names = self.run_page("docs/guide/policy_servers.md", least=3)
        names["server"].shutdown()
        # The policy sees 3.2 m to each side.
        self.assertGreater(abs(names["found"].counterexamples[0].scenario["start"]), 3.0)

    def test_the_page_of_logs_runs(self):
        # The verdicts of the command above on the page.
        found = self.run_page("docs/guide/logs.md", least=2)
        self.assertEqual(
            [each.name for each in found["found"].verdicts if each.violated], ["slow", "stops"]
        )

    def test_the_page_of_requirements_runs(self):
        self.run_page("docs/guide/requirements.md", least=1)

    def test_the_page_of_online_monitors_runs(self):
        self.run_page("docs/guide/online.md", least=3)

    def test_the_page_of_guards_runs(self):
        self.run_page("docs/guide/guard.md", least=2)

    def test_the_page_of_online_monitors_quotes_tested_programs(self):
        page = (ROOT / "docs/guide/online.md").read_text()
        for language, source in [
            ("rust", "crates/stl/src/online/mod.rs"), ("c", "crates/monitor-c/examples/monitor.c")
        ]:
            tested = {
                line.removeprefix("///").strip()
                for line in (ROOT / source).read_text().splitlines()
            }
            (block,) = re.findall(rf"```{language}\n(.*?)```", page, flags=re.DOTALL)
            for line in filter(None, block.splitlines()):
                self.assertIn(line.strip(), tested, source)

    def test_the_table_of_the_examples_is_that_of_their_results(self):
        sys.path.insert(0, str(ROOT / "python/examples"))
        self.addCleanup(sys.path.pop, 0)
        page = (ROOT / "docs/guide/examples.md").read_text()
        with_table = importlib.import_module("recording").with_table
        self.assertEqual(with_table(page), page)
        self.assertNotEqual(
            with_table(page.replace("same bits", "other bits")),
            page.replace("same bits", "other bits")
        )
