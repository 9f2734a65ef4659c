"""A service with the scenario's terrain: one that runs, or one of its own for as long as it is needed."""

import contextlib
import os
import pathlib
import re
import subprocess
import sys

from selenograph import Client

ROOT = pathlib.Path(__file__).resolve().parents[3]


def terrain(scenario, binary, work):
    """The folder of the scenario's DEM; made, where it is sample terrain."""
    if not scenario.sample:
        base = os.environ.get("SELENOGRAPH_SHARED_DATA") or ROOT.parent / "shared" / "data"
        folder = pathlib.Path(base) / (scenario.site or scenario.name)
        if not folder.is_dir():
            sys.exit(f"scenario {scenario.name} needs {folder}, or SELENOGRAPH_SHARED_DATA to name its parent")
        return folder
    folder = work / "dem" / scenario.name
    if not (folder / "whole").exists():
        subprocess.run([binary, "sample", folder, *scenario.sample], check=True, stdout=subprocess.DEVNULL)
        (folder / "whole").touch()
    return folder


@contextlib.contextmanager
def started(scenario, binary, work, url=None):
    if url:
        with Client(url, timeout_s=600) as client:
            yield client
        return
    folder = terrain(scenario, binary, work)
    command = [binary, "serve", "--port", "0", "--deadline-s", "600", "--cache-dir", work / "cache", "--dem", folder,
               "--assets-dir", ROOT / "deploy" / "assets"]
    work.mkdir(parents=True, exist_ok=True)
    with open(work / "service.log", "w") as log:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True)
        try:
            line = process.stdout.readline()
            found = re.search(r"listening on (http://\S+)", line)
            if not found:
                sys.exit(f"the service did not start; see {work / 'service.log'}")
            with Client(found[1], timeout_s=600) as client:
                yield client
        finally:
            process.terminate()
            process.wait()
            process.stdout.close()
