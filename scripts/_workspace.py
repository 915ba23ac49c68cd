"""Where the scripts build."""

import os
import subprocess

SCRIPTS = os.path.dirname(os.path.realpath(__file__))


def script_workspace() -> str:
    """As _common.sh says."""
    command = 'source "$0" && echo "$workspace"'
    result = subprocess.run(['bash', '-c', command, os.path.join(SCRIPTS, '_common.sh')],
                            stdout=subprocess.PIPE, universal_newlines=True, check=True)
    return result.stdout.strip()
