#!/usr/bin/env python3
"""README's tables of parameters are those that the programs print."""

import os
import re
import unittest

from tool_fixture import run

README = os.path.join(os.path.dirname(os.path.dirname(os.path.realpath(__file__))), "README.md")
TABLE = r"<!-- {0}: [^>]*-->\n(.*?)\n<!-- end of {0} -->"


class DocumentationTest(unittest.TestCase):
    def check(self, name, program):
        with open(README, encoding="utf-8") as file:
            table = re.search(TABLE.format(name), file.read(), re.DOTALL).group(1)
        self.assertEqual(table, run(program, "--print-parameters").stdout.strip())

    def test_table_of_parameters(self):
        self.check("parameters", "offline_odometry")

    def test_table_of_the_synthetic_world(self):
        self.check("world", "synthetic_world")


if __name__ == "__main__":
    unittest.main()
