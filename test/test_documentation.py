#!/usr/bin/env python3
"""README's table of parameters is the one that the programs print."""

import os
import re
import unittest

from tool_fixture import run

README = os.path.join(os.path.dirname(os.path.dirname(os.path.realpath(__file__))), "README.md")
TABLE = re.compile(r"<!-- parameters: [^>]*-->\n(.*?)\n<!-- end of parameters -->", re.DOTALL)


class DocumentationTest(unittest.TestCase):
    def test_table_of_parameters(self):
        with open(README, encoding="utf-8") as file:
            table = TABLE.search(file.read()).group(1)
        self.assertEqual(table, run("offline_odometry", "--print-parameters").stdout.strip())


if __name__ == "__main__":
    unittest.main()
