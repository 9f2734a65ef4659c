"""Runs programs of the clients in other languages: (exit status, standard output, standard error).

SELENOGRAPH_CPP_EXAMPLES is the folder of the built C++ programs.
"""

import os
import shutil
import subprocess

from harness import PATIENCE_S
from one_service import CLIENTS

CPP_EXAMPLES = os.environ.get("SELENOGRAPH_CPP_EXAMPLES", "")
OCTAVE = shutil.which("octave-cli") or shutil.which("octave")


def run_cpp(name, *arguments):
    return _run(os.path.join(CPP_EXAMPLES, name), *arguments)


def run_octave(statement):
    """Runs a statement of Octave. The status is 2 of a refusal, 1 of another error."""
    paths = [os.path.join(CLIENTS, "matlab"), os.path.join(CLIENTS, "matlab", "examples"), os.path.join(CLIENTS, "tests")]
    script = ("addpath('%s'); try, %s; catch e, fputs(stderr, [e.identifier ': ' e.message]); "
              "exit(1 + strcmp(e.identifier, 'selenograph:refused')); end; exit(0);" % ("', '".join(paths), statement))
    return _run(OCTAVE, "--no-gui", "--norc", "--quiet", "--eval", script)


def run_octave_function(name, *arguments):
    """Calls a function of Octave with texts."""
    return run_octave("%s(%s)" % (name, ", ".join("'%s'" % argument for argument in arguments)))


def _run(*command):
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=PATIENCE_S)
    return done.returncode, done.stdout, done.stderr
