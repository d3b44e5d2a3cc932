"""Measurements in processes of their own, and where results go."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any


def alone(file: str, *words: str, env: dict[str, str]) -> Any:
    """What `file --alone words…` prints, as JSON, in a new process."""
    command = [sys.executable, file, "--alone", *words]
    return json.loads(subprocess.run(command, env=env, stdout=subprocess.PIPE, check=True).stdout)


def written(found: Any, folder: Path, name: str) -> None:
    """Print what was found, and write it into `folder`."""
    text = json.dumps(found, indent=1)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(text + "\n")
    print(text)
