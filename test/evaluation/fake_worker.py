"""A worker without poise that behaves as the name of its source asks: for tests of what happens to real workers."""

import json
import os
import signal
import sys
import time
from pathlib import Path

for line in sys.stdin:
    task = json.loads(line)
    name = Path(task["source"]).name
    if name.startswith("deadly"):
        os.kill(os.getpid(), signal.SIGKILL)
    if name.startswith("killed_once") and not Path(task["source"] + ".tried").exists():
        Path(task["source"] + ".tried").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if name.startswith("endless"):
        time.sleep(3600)
    build = "0.0.1+old" if name.startswith("outdated") else task["build"]
    reply = {"answer": {"size": len(name)}, "error": None, "build": build, "sha256": name, "seconds": 0.001}
    print(json.dumps({"refused": build} if build != task["build"] else reply), flush=True)
